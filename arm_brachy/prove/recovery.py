"""How much of what an oracle gains an answer gains, on pads, speed and amplitude never shown.

Three models of our own meet the noise-free signals of a protocol that the detector never saw: the
scene with the modulus alone fitted, the same with the terms that the answer names, and with the
true terms at their true values. What sensors do is left out on both sides, and what the tissue
remembers of the recording on ours.
Test: prove/test_recovery.py
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.scene import load_scene
from arm_brachy.core.term import Kind
from arm_brachy.diagnosis.model.forward import STAGES, ForwardModel
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.signals.motion import Path as Travel
from arm_brachy.diagnosis.signals.stream import FORCE
from arm_brachy.experiments.blind_trials import OWN
from arm_brachy.experiments.diagnosis_score import MESH
from arm_brachy.prove.folder import read_json, write_json
from arm_brachy.prove.score import form_of
from arm_brachy.registry import by_name, parse_terms

INSTANTS = 12       # that are solved for: a state takes about a second
GAIN = 1.2          # least ratio of errors, base over oracle, for there to be something to gain
THEIRS = {'force': 'forces'}    # their word for a stream of ours


def recover_all(folder, key, truths, records, workers, progress):
    """'mode/case' -> columns of `recover`, for answers to what can be gained from; kept in a file.

    folder : TrialFolder;  key : of the sealed folders;  truths, records : as `trial.run`
    workers : Workers
    """
    found = read_json(folder / 'recovery.json') or {}
    tasks = {f'{mode}/{case}': (folder.given(case), folder.sealed(key, case) / 'heldout.npz',
                                truths[case], record['answer'])
             for (mode, case), record in records.items() if f'{mode}/{case}' not in found
             and record['answer'] is not None and _moves(truths[case])}
    progress('held-out recovery', 0, len(tasks))
    for done, (name, one) in enumerate(
            zip(tasks, workers.each(recover, tasks.values()), strict=True), start=1):
        found[name] = one
        write_json(folder / 'recovery.json', found)
        progress('held-out recovery', done, len(tasks))
    return found


def recover(given, heldout, truth, answer):
    """Errors in noise standard deviations (rms over streams) and the share that is recovered.

    given : folder with scene.yaml;  heldout : .npz with '<stream>/t_s', '/names', '/values'
    Returns error_base, error_tool, error_oracle, recovery: (base - tool) / (base - oracle), None
    where an oracle gains less than GAIN or a model has no solution, which `recovery_words` says.
    """
    with np.load(heldout) as file:
        signals = {name: file[name] for name in file.files}
    told = answer['recalibrated'].get('E_kPa')
    modulus = truth['E_kPa'] if told is None else told['value']
    true = truth['E_kPa'] * truth['nuisances']['modulus_factor']
    try:
        scene = load_scene(Path(given) / 'scene.yaml')
        models = {'base': (modulus, ()), 'tool': (modulus, said_terms(answer)),
                  'oracle': (true, true_terms(truth, [pad.name for pad in scene.pads]))}
        errors = {f'error_{name}': error(scene, signals, truth, *model)
                  for name, model in models.items()}
    except ArmBrachyError as trouble:
        return {'recovery': None, 'recovery_words': str(trouble)}
    gain = errors['error_base'] - errors['error_oracle']
    open_ = errors['error_base'] < GAIN * errors['error_oracle']
    return {**errors, 'recovery_words': '', 'recovery': None if open_ else
            (errors['error_base'] - errors['error_tool']) / gain}


def error(scene, signals, truth, modulus, terms, *, learnt=None):
    """Rms over all streams of model less signals, over the noise [sd].

    modulus : [kPa];  signals : as in the file of `recover`
    learnt : kind, travels (m, p) -> (m, c, 3) to add
    In all models alike, where the pads meet the tissue is taken as it was, and forces are scaled
    to fit: a modulus belongs to a mesh and to the terms beside it, and is nobody's cause.
    Raises ArmBrachyError if a state is not found.
    """
    scene = replace(scene, material=replace(scene.material, E=1e3 * modulus))
    late = truth['duration_s'] + truth['start_s']      # it begins where the recording ends
    t = signals['encoders/t_s'] + late
    q = signals['encoders/values'] - np.array(truth['nuisances']['touch_m'])
    at = np.linspace(0.0, 1.0, INSTANTS + 2)[1:-1] * (t[-1] - t[0]) + t[0]
    travel = Travel(t, q)
    found = ForwardModel(specimen_of(scene), terms).predict(travel, at)
    if not found.valid.all():
        raise ArmBrachyError('a state of the held-out protocol was not found')
    squares = []
    for kind in STAGES:
        name = THEIRS.get(kind, kind)
        true = _at(at - late, signals[f'{name}/t_s'], signals[f'{name}/values'])
        shown = found.get(kind)
        if kind == FORCE:
            shown = shown * np.sum(shown * true) / np.sum(shown**2)
        if learnt is not None:
            shown = shown + learnt(kind, travel.at(at))
        off = shown - true
        squares.append(np.mean(np.square(off / truth['sensors']['noise'][name])))
    return float(np.sqrt(np.mean(squares)))


def said_terms(answer):
    """The terms of an answer's likeliest option that act on the body or its pads, instances."""
    options = {}
    for cause in answer['causes']:
        options.setdefault(cause['option'], []).append(cause)
    chosen = options.pop(0, [])
    if options:
        chosen = chosen + max(options.values(), key=lambda some: some[0]['probability'])
    return _built([{'name': c['term'], **c['applies_to'],
                    **{key: one['value'] for key, one in c['parameters'].items()}}
                   for c in chosen if c['term'] != MESH])


def true_terms(truth, pads):
    """The planted terms that act on the body or its pads, instances of the registry's.

    pads : names, order of the scene: the registry counts actuators, the truth names them
    """
    entries = [{'name': e['name'], **e['values']} for e in truth['effects']]
    for entry in entries:
        if 'actuators' in entry:
            entry['actuators'] = [pads.index(name) for name in entry['actuators']]
    return _built(entries)


def _built(entries):
    return parse_terms([e for e in entries if _physical(e['name'])], 'blind trial')


def _physical(name):
    return by_name(name).spec.kind is not Kind.SENSING


def _moves(truth):
    """True if something in the catalogue was planted that acts on the body or its pads.

    All by the registry's laws: of another there is no oracle among our models.
    """
    return form_of(truth) == OWN and any(_physical(e['name']) for e in truth['effects'])


def _at(times, t, values):
    flat = values.reshape(len(t), -1)
    seen = np.column_stack([np.interp(times, t, column) for column in flat.T])
    return seen.reshape(len(times), *values.shape[1:])
