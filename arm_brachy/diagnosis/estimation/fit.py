"""What was chosen, fitted in full: numbers with intervals, and how well kinds held out are met."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import InputError, MeshError, NotConverged
from arm_brachy.core.quantity import quantities
from arm_brachy.core.term import Stage
from arm_brachy.diagnosis.estimation.cross_validation import Part, chords
from arm_brachy.diagnosis.estimation.fit_model import Data
from arm_brachy.diagnosis.estimation.map_fit import Options, Refit, refit
from arm_brachy.diagnosis.likelihood.constitutive_error import by_nodes, law_of, widened
from arm_brachy.diagnosis.likelihood.discretisation import NAMES
from arm_brachy.diagnosis.likelihood.loose_pad_offset import standing_back
from arm_brachy.diagnosis.likelihood.match import SET_UP
from arm_brachy.diagnosis.likelihood.nuisances import MODULUS, TOUCH
from arm_brachy.diagnosis.likelihood.pad_offset import matters, otherwise
from arm_brachy.diagnosis.likelihood.preload import preload
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.hypothesis import hypothesis
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.settings import Rules
from arm_brachy.diagnosis.signals.motion import Path, corners_of
from arm_brachy.diagnosis.signals.stream import FORCE
from arm_brachy.tissue.assembly import InvertedElement
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

CORNER = 0.02       # of the largest travel, that a path may be off between its corners
STATES = 20         # of each recording at which causes are fitted in full,
SHOWING = 6         # and those in which they show most
FAINTER = 0.5**np.arange(6)      # of what responses ask for, tried as a start
# Forward runs of each recording for a cause that its response does not claim: what has not settled
# by then is worth what its response says. A wall takes a dozen for one set of derivatives.
RUNS_OF_FAINT = 30
TANGENT, CHORD, AS_FOUND = 'tangent', 'chord', 'as found'    # of `parts_of`


@dataclass(frozen=True)
class Fitted:
    """A judge.Candidate with its numbers.

    hypotheses : hypothesis.Hypothesis each;  terms : of the registry, as found
    estimates : per hypothesis {field: cause.Estimate}
    refit : map_fit.Refit, None where it did not settle; its last term is the scale of the modulus
    kept : per recording that may lack something (k,) numbers of the states they were fitted at
    scale : Estimate of the modulus over that of the model, fitted with them; None without refit
    notes : sentences
    back : per such recording columns (N, g) of pads off their zeros where that is not as the model
        without the causes answers: loose ones (`loose_pad_offset`), tissue that changes
        (`preload`), another body (`pad_offset`)
    covariance : (k, k) of the coordinates of `refit`, their laws' errors in it; None without refit
    end : (k,) where the fit ended, settled or not; None where it did not begin
    """

    hypotheses: tuple
    terms: tuple
    estimates: tuple
    refit: Refit | None
    kept: tuple
    scale: Estimate | None = None
    notes: tuple = ()
    back: tuple = ()
    covariance: np.ndarray | None = None
    end: np.ndarray | None = None

    def causes(self, probability):
        """cause.Cause each, that hold together."""
        return tuple(Cause(one.name, {**self._placed(i), **self.estimates[i]}, self._chosen(i),
                           float(min(probability, 1.0)))
                     for i, one in enumerate(self.hypotheses))

    def _placed(self, i):
        """Estimates of what a candidate gave and no fit changed: their error is not known."""
        scaled = set(Cause(self.hypotheses[i].name).declared.__dataclass_fields__)
        return {name: Estimate.unsure(value) for name, value in self.hypotheses[i].place.items()
                if name in scaled and name not in self.estimates[i] and _number(value)}

    def _chosen(self, i):
        return {k: v for k, v in self.hypotheses[i].place.items() if not _number(v)
                or k == 'pad'}


def _number(value):
    return not isinstance(value, str) and np.size(value) > 0 and all(
        isinstance(v, float) for v in np.atleast_1d(np.array(value, dtype=object)))


def sizes_of(assembly, candidate):
    """(Hypotheses, amplitudes (k,) each) of a judge.Candidate, in typical sizes."""
    hypotheses = tuple(assembly.hypothesis_of(e)[0] for e in candidate.explanations)
    amplitudes, first = [], 0
    for one in hypotheses:
        spread = np.array([s.spread for s in one.strengths])
        amplitudes.append(spread * candidate.mean[first:first + len(spread)])
        first += len(spread)
    return hypotheses, amplitudes


def fit_in_full(assembly, candidate, law, start=None):
    """Fitted of a judge.Candidate of an problem.Assembly, at some states of each recording.

    law : discrepancy.Accuracy.law, which intervals of causes in the tissue include
    start : Fitted.end of the same hypotheses in other noise, from which it begins; None = from
        the linear answer

    Where the full fit does not settle, the numbers are those of the linear answer, without
    intervals, and a note says so.
    """
    hypotheses, amplitudes = sizes_of(assembly, candidate)
    suspects = assembly.suspects
    kept = tuple(_kept(m, effect) for m, effect in zip(suspects, _effects(assembly, candidate),
                                                       strict=False))
    data = [replace(without_modulus(m, some), absent=tuple(
        i for i, one in enumerate(hypotheses) if not one.acts_in(number)))
        for number, (m, some) in enumerate(zip(suspects, kept, strict=True))]
    modulus = hypothesis(StiffnessScale)
    options = options_for(candidate)
    try:
        sizes = [possible_start(suspects[0].baseline.model.specimen.body, *x)
                 for x in zip(hypotheses, amplitudes, strict=True)]
        back = tuple(_off_zero(m, one, hypotheses, sizes)
                     for m, one in zip(suspects, data, strict=True))
        data = [one.beside(columns) for one, columns in zip(data, back, strict=True)]
        found = refit(data, (*hypotheses, modulus), (*sizes, np.zeros(1)), start=start,
                      options=options)
        more = _as_found(suspects, data, found)
        if more:
            data = [one.beside(columns) for one, columns in zip(data, more, strict=True)]
            back = tuple(np.hstack(pair) for pair in zip(back, more, strict=True))
            found = refit(data, (*hypotheses, modulus), (*sizes, np.zeros(1)), start=found.z,
                          options=options)
    except (NotConverged, InputError, InvertedElement) as error:
        amplitudes = [_allowed(*x) for x in zip(hypotheses, amplitudes, strict=True)]
        estimates = tuple(unsettled(*x) for x in zip(hypotheses, amplitudes, strict=True))
        terms = tuple(one.term(a) for one, a in zip(hypotheses, amplitudes, strict=True))
        names = ' and '.join(one.name for one in hypotheses)
        return Fitted(hypotheses, terms, estimates, None, kept, None, (
            f'The full fit of {names} did not settle ({error}); its numbers are those of the '
            'linear answer, without intervals.',), end=getattr(error, 'z', None))
    n, covariance = len(hypotheses), found.covariance
    if any(term.stage is Stage.BODY for term in found.terms[:n]):
        covariance = widened(found, data, found.terms[n].factor, law_of(hypotheses, law),
                             by_nodes(hypotheses))
    estimates = found.space.estimates(found.z, found.mean, covariance)
    return Fitted(hypotheses, found.terms[:n], tuple(estimates[i] for i in range(n)), found,
                  kept, estimates[n]['factor'], back=back, covariance=covariance, end=found.z)


def options_for(candidate):
    """The map_fit.Options of a judge.Candidate by its response: a faint one is soon given up."""
    faint = candidate.evidence < Rules().evidence
    return Options(runs=RUNS_OF_FAINT) if faint else Options()


def _off_zero(m, data, hypotheses, amplitudes):
    """Columns (N, g) of pads off their zeros beside terms of about these amplitudes."""
    terms = data.present([one.term(_allowed(one, a))
                          for one, a in zip(hypotheses, amplitudes, strict=True)])
    touch = m.recorded.prepared.calibration.touch
    return np.hstack([standing_back(data, terms, touch), preload(data, terms, touch)])


def _as_found(suspects, data, found):
    """Columns (N, p) of each recording of pads off their zeros in the body as it was found, by
    which these differ from those of the model; () where that is no matter.
    """
    touch, which = suspects[0].recorded.prepared.calibration.touch, []
    for m, one in zip(suspects, data, strict=True):
        names = [name for name in m.nuisances.names if name != MODULUS]     # `back` follows them
        which.append(np.pad([name.startswith(TOUCH) for name in names],
                            (0, one.U.shape[1] - len(names))))
    if not matters(data, found.residual, which, touch):
        return ()
    return tuple(otherwise(one, found.terms, touch) for one in data)


def _effects(assembly, candidate):
    """(N,) effect of a candidate over the noise, a part for each recording."""
    effect = np.hstack([e.columns for e in candidate.explanations]) @ candidate.mean
    return np.split(effect, np.cumsum([len(m.r) for m in assembly.matched])[:-1])


def _kept(m, effect=None):
    """Numbers (k,) of the states of a Matched for a full fit; effect : (N,) or None."""
    n = len(m.recorded.states.t)
    even = np.unique(np.linspace(0, n - 1, min(n, STATES)).round().astype(int))
    if effect is None:
        return even
    shown = np.bincount(m.observables.states, effect**2, minlength=n)
    return np.union1d(even, np.argsort(-shown, kind='stable')[:SHOWING])


def without_modulus(m, states):
    """refit.Data of a Matched in which the modulus is no nuisance: other numbers are relative to
    it, so that it is fitted in full with them.
    """
    data = data_of(m, states)
    kept = np.array([name != MODULUS for name in m.nuisances.names], dtype=bool)
    return replace(data, U=data.U[:, kept], own=data.own[kept])


def _allowed(hypothesis, amplitudes):
    """(k,) amplitudes cut to what the limits of the parameters allow."""
    infos, out = quantities(hypothesis.cls), []
    for strength, a in zip(hypothesis.strengths, amplitudes, strict=True):
        info, unit = infos[strength.name], strength.typical - strength.neutral
        if np.isfinite(strength.neutral):
            ends = sorted((info.scale * limit - strength.neutral) / unit for limit in (
                -np.inf if info.low is None else info.low,
                np.inf if info.high is None else info.high))
            a = min(max(a, ends[0]), ends[1])
        out.append(a)
    return np.array(out)


def possible_start(body, hypothesis, amplitudes):
    """(k,) amplitudes, all made fainter until the body can be so.

    A bump that is narrower than the real one, or beside it, has to be higher by its response than
    elements stand; where it may go and how wide it is, only the full fit says.
    Raises MeshError where it can be so at no size.
    """
    if hypothesis.cls.spec.stage is not Stage.BODY:
        return amplitudes
    for share in FAINTER:
        try:
            hypothesis.term(_allowed(hypothesis, share * amplitudes)).prepare(body)
            return share * amplitudes
        except MeshError as error:
            refused = error
    raise refused


def unsettled(hypothesis, amplitude):
    """{field: Estimate} of the strengths by the linear answer, how far off nobody knows."""
    values = {}
    for strength, a in zip(hypothesis.strengths, amplitude, strict=True):
        value = strength.value(a)
        values[strength.name] = value if strength.component is None else (
            *values.get(strength.name, ()), value)
    return {name: Estimate.unsure(value) for name, value in values.items()}


def data_of(m, kept):
    """refit.Data of a Matched at the states of numbers `kept` (k,)."""
    observables = m.observables.at(kept)
    U = observables.whiten({kind: v[kept] for kind, v in m.nuisances.values.items()})
    return Data(m.baseline.model.specimen, _coarse(m.recorded.path, m.recorded.states.t[kept]),
                m.recorded.states.t[kept], observables, U, m.baseline.model.terms,
                m.baseline.take(kept), {kind: v[kept] for kind, v in m.finer.items()},
                own=m.own)


def _coarse(path, t):
    """The transmission.Path with its values at t and the corners that a memory notices."""
    travel = float(np.ptp(path.q, axis=0).max(initial=0.0))
    kept = np.union1d(corners_of(path.t, path.q, CORNER * travel), np.searchsorted(path.t, t))
    return Path(path.t[kept], path.q[kept])


def parts_of(assembly, fitted, ratio, *, numbers=TANGENT):
    """held_out.Part of every recording that may lack something.

    fitted : Fitted of what was found beside what the model has, None = nothing
    ratio : of the model's modulus to the scene's
    numbers : TANGENT, those found are free to first order; CHORD, so, but without any the model
        is the one without causes (`cross_validation.chords`); AS_FOUND: so they are in what was
        not fitted (`tested_part`), and the modulus with them is not to be told twice
    """
    out = []
    for i, (raw, m) in enumerate(zip(assembly.matched, assembly.suspects, strict=False)):
        kept = _kept(m) if fitted is None else fitted.kept[i]
        data = data_of(m, kept)
        kinds = np.array(m.recorded.kinds, dtype=object)[kept][data.observables.states]
        shown = {kind: values[kept] for kind, values in m.baseline.shown.items()}
        of_mesh = data.observables.whiten_shift(data.finer)
        named, columns, back = data.observables.residual(shown), np.zeros((len(kinds), 0)), None
        if fitted is not None and fitted.refit is not None:
            there, back = fitted.refit.residual[i] + of_mesh, fitted.back[i]
            columns = _free(numbers, fitted.refit, i, named - there)
            named = there + columns @ fitted.refit.z[:columns.shape[1]]
        found = fitted is not None or bool(m.baseline.model.terms)
        plain = _without_terms(m, data.encoder, data.t, shown)
        given = _given(raw.observables.at(kept), plain, ratio)
        out.append(_part(m, given, data.observables, kinds, data.U, plain, of_mesh,
                         (named, columns, back) if found else ()))
    return out


def times_of(assembly, fitted):
    """(k,) [s] of the states of every Part of `parts_of`."""
    return [m.recorded.states.t[_kept(m) if fitted is None else fitted.kept[i]]
            for i, m in enumerate(assembly.suspects)]


def _free(numbers, refit, i, effect):
    """(N, p) columns of the numbers of a Refit in recording i, on which they have an effect (N,).

    numbers : as of `parts_of`
    """
    columns = refit.columns[i]
    if numbers == CHORD:
        return chords(columns, refit.z, effect)
    return columns if numbers == TANGENT else columns[:, :0]


def tested_part(assembly, raw, fitted, ratio):
    """held_out.Part of a Matched that was not fitted, with what was found elsewhere."""
    m = assembly.put_right(raw)
    named = m.observables.residual(m.baseline.shown)
    if fitted is not None and fitted.refit is not None:
        here = (term for term, one in zip(fitted.terms, fitted.hypotheses, strict=True)
                if one.acts_in(None))
        model = ForwardModel(m.baseline.model.specimen, (
            *m.baseline.model.terms, *here, *fitted.refit.terms[len(fitted.terms):]))
        found = _shown(model, m, m.recorded.path, m.recorded.states.t)
        named = m.observables.residual(found)
    found = fitted is not None or bool(m.baseline.model.terms)
    plain = _without_terms(m, m.recorded.path, m.recorded.states.t, m.baseline.shown)
    given = _given(raw.observables, plain, ratio)
    return _part(m, given, m.observables, m.kinds, m.U, plain, m.of_mesh,
                 (named, np.zeros((len(named), 0))) if found else ())


def _given(observables, plain, ratio):
    """(N,) SI, measured less the scene as it came; plain : what the model shows without a term."""
    return observables.difference({**plain, FORCE: plain[FORCE] / ratio})


def _part(m, given, observables, kinds, U, plain, of_mesh, found):
    """The Part; plain : what the model shows without any term."""
    return Part(observables, kinds, given, observables.residual(plain), U, m.own,
                np.isin(m.nuisances.names, NAMES),
                np.array([name.startswith(SET_UP) for name in m.nuisances.names]),
                of_mesh, *found)


def _without_terms(m, encoder, t, shown):
    """kind -> (n, c, 3) of the specimen as it is, at instants at which `shown` is with terms."""
    if not m.baseline.model.terms:
        return shown
    return _shown(ForwardModel(m.baseline.model.specimen), m, encoder, t)


def _shown(model, m, encoder, t):
    found = model.predict(encoder, t)
    if not found.valid.all():
        raise NotConverged(f'{m.recorded.name}: the model has no state at '
                           f'{found.t[np.argmin(found.valid)]:.2f} s')
    return {kind: found.get(kind) for kind in m.baseline.shown}
