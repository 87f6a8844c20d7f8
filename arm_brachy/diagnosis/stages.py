"""The stages before any decision: signals, model, and the linear screen of candidate terms.

    evidence -> recorded (no tissue model) -> matched (model, residual, nuisances)
             -> tried (every term everywhere, by its sensitivity)

Test: diagnosis/test_partial.py, diagnosis/test_diagnose.py
"""

from collections import defaultdict
from dataclasses import dataclass, field, replace

import numpy as np

from arm_brachy.core.random import stream
from arm_brachy.diagnosis.isolation.handover import given, occasions_of
from arm_brachy.diagnosis.isolation.looks import look_at
from arm_brachy.diagnosis.likelihood.discretisation import EnsembleOptions, ensemble_of
from arm_brachy.diagnosis.likelihood.inertia_bound import inertia_of, with_lag
from arm_brachy.diagnosis.likelihood.match import match
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.modulus import modulus_ratio, scaled
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.progress import MESHES, MODEL, SCREEN, SIGNALS, untold
from arm_brachy.diagnosis.results.channels import CARRIERS
from arm_brachy.diagnosis.results.formatting import spoken
from arm_brachy.diagnosis.results.parts import Recording
from arm_brachy.diagnosis.selection.pad_marker_check import astray, unled
from arm_brachy.diagnosis.selection.screening import try_all

COSTLY = ('pad_slip',)      # more than half of the time of a screen


@dataclass
class Known:
    """What the steps of a diagnosis that are over have found; empty where they are not.

    evidences, held_out, null : loading.Evidence each;  calibration : finding.Calibration
    looked, sound, tested : Recorded of those fitted, of nulls, of those held out
    left_out : sentences;  ratio : modulus of the model over the scene's
    ensemble : discretisation.Ensemble;  matched, tests : Matched of fitted and nulls, of held out
    tried : screening.Tried
    assembly, fits : problem.Assembly and full_fits.FullFits, once the decision has begun
    free : free_body.FreeKnown of a body without pads
    steps : names of the steps that are over, of `progress.STEPS`
    """

    evidences: tuple = ()
    held_out: tuple = ()
    null: tuple = ()
    calibration: object = None
    looked: tuple = ()
    sound: tuple = ()
    tested: tuple = ()
    left_out: tuple = ()
    ratio: float = 1.0
    ensemble: object = None
    matched: tuple = ()
    tests: tuple = ()
    tried: object = None
    assembly: object = None
    fits: object = None
    free: object = None
    steps: list = field(default_factory=list)


@dataclass(frozen=True)
class Quick:
    """What a quick look makes coarser, so that it takes 20 s: it changes no rule."""

    states: int = 12        # load states of all recordings together
    members: int = 1        # perturbed meshes
    places: int = 3         # of a candidate term, on each pad, marker or stream

    def thin(self, tried):
        """Hypotheses, or free_hypotheses.Frees, that are tried: so many places of each, evenly."""
        groups = defaultdict(list)
        for one in tried:
            hypothesis = getattr(one, 'hypothesis', one)
            if hypothesis.name not in COSTLY:
                groups[hypothesis.name, *((key, str(hypothesis.place[key])) for key in CARRIERS
                                          if key in hypothesis.place)].append(one)
        kept = {id(some[i]) for some in groups.values() for i in np.unique(np.linspace(
            0, len(some) - 1, min(len(some), self.places)).round().astype(int))}
        return tuple(one for one in tried if id(one) in kept)

    def said(self, scene):
        """Sentences on it, for recordings of a core.scene.Scene."""
        end = ('Candidate terms were ranked by their sensitivities alone, to first order: no full '
               'fit, no comparison of pairs, no verdict.')
        if not scene.pads:
            return (f'Of each candidate term {self.places} places at most were tried.', end)
        return (f'The model was compared at {self.states} load states at most, and its memory '
                'follows a path through these alone.',
                f'The error of the mesh comes from {self.members} perturbed mesh and none that is '
                f'finer; of each candidate term {self.places} places at most were tried on each '
                f'pad, marker or stream; not tried: {", ".join(map(spoken, COSTLY))}.', end)


def screen(known, evidences, held_out=(), null=(), calibration=None, *, seed=0, accuracy=None,
           meshes=None, progress=untold, quick=None, jobs=1):
    """Fill a Known up to the linear screen; arguments as of `pipeline.diagnose`.

    quick : Quick, None = nothing is coarser
    Raises what `looks.look_at`, `discretisation.ensemble_of` and `match.match` raise.
    """
    known.evidences, known.held_out, known.null = evidences, held_out, null
    scene, every = evidences[0].scene, (*evidences, *null, *held_out)
    known.calibration = calibration = with_lag(calibration, scene)
    progress(SIGNALS, 0, len(every), every[0].name)
    (looked, left_out), (sound, fewer), (tested, fewest) = look_at(
        (evidences, null, held_out), calibration,
        lambda share: progress(SIGNALS, round(share * len(every)), len(every)),
        **({} if quick is None else {'most': quick.states}))
    if quick is not None:
        looked, sound, tested = (tuple(map(_through_states, some))
                                 for some in (looked, sound, tested))
    known.looked, known.sound, known.tested = looked, sound, tested
    known.left_out = (*left_out, *fewer, *fewest)
    known.steps.append(SIGNALS)
    if quick is not None:
        meshes = EnsembleOptions(members=quick.members, finer=False)
    specimen, known.ratio = _specimen((*looked, *sound), scene)
    ensemble = ensemble_of(ForwardModel(specimen), stream(seed, 'meshes'), meshes, progress)
    inertia = inertia_of(specimen)

    def matches(looked, every):
        """Matched of every Recorded, with what those of `looked` are certain of."""
        out = []
        progress(MODEL, 0, len(every), every[0].name)
        for one in every:
            out.append(match(one, specimen, ensemble, given((one,), beside=looked).terms,
                             calibration=calibration, accuracy=accuracy, several=len(every) > 1,
                             inertia=inertia))
            progress(MODEL, len(out), len(every))
        return out

    looked, sound, tested, matched = _led_by_pads(looked, sound, tested, matches)
    known.looked, known.sound, known.tested, known.ensemble = looked, sound, tested, ensemble
    known.matched, known.tests = (matched[:len(looked) + len(sound)],
                                  matched[len(looked) + len(sound):])
    known.steps += [MESHES, MODEL]
    known.tried = try_all(known.matched, occasions_of(looked),
                          lambda done, of, name: progress(SCREEN, done, of, name),
                          thin=None if quick is None else quick.thin, jobs=jobs)
    known.steps.append(SCREEN)


def _through_states(recorded):
    """The Recorded whose pads go straight from load state to load state."""
    states = recorded.states
    return replace(recorded, states=replace(states, path_t=states.t, path_q=states.q,
                                            state=np.arange(len(states.t))))


def recordings_of(known):
    """statements.Recording of everything in a Known that was looked at."""
    roles = ('fitted' if known.tested else 'fitted, kinds held out in turn', 'held out', 'null')
    return tuple(Recording(one.name, role, *map(float, one.prepared.evidence.span))
                 for group, role in zip((known.looked, known.tested, known.sound), roles,
                                        strict=True)
                 for one in group)


def notes_of(looked):
    """Notes of Recorded recordings and of their noise."""
    return [note for one in looked for note in (
        *one.prepared.evidence.notes,
        *(note for noise in one.prepared.noise.values() for note in noise.notes))]


def _specimen(recorded, scene):
    """(Specimen with the modulus that forces ask for, its ratio to the scene's).

    recorded : Recorded of one body; the first whose forces tell it does
    """
    specimen = specimen_of(scene)
    ratio = next((one for one in (modulus_ratio(some, specimen) for some in recorded)
                  if one != 1.0), 1.0)
    better = scaled(scene, ratio)
    if better is scene:
        return specimen, 1.0
    return specimen_of(better, specimen.mesh), ratio


def _led_by_pads(looked, sound, tested, matches):
    """The three groups of Recorded, and Matched each, without markers that go astray from pads.

    matches : (looked, all three) -> Matched each. Held out recordings do not say which go astray.
    """
    matched = matches(looked, (*looked, *sound, *tested))
    fitted = matched[:len(looked) + len(sound)]
    strays = astray(fitted, [given((m.recorded,), beside=looked).open_terms for m in fitted])
    if not strays:
        return looked, sound, tested, matched
    looked, sound, tested = (tuple(unled(one, strays) for one in some)
                             for some in (looked, sound, tested))
    return looked, sound, tested, matches(looked, (*looked, *sound, *tested))
