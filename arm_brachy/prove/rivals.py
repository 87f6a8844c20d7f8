"""The baselines on the cases of a trial: the detector's own linear problem, answered five ways.

Test: prove/test_rivals.py
"""

import numpy as np

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.random import stream
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.isolation.handover import given, occasions_of
from arm_brachy.diagnosis.isolation.recordings import look
from arm_brachy.diagnosis.likelihood.discretisation import ensemble_of
from arm_brachy.diagnosis.likelihood.match import match
from arm_brachy.diagnosis.likelihood.observation import channels_of
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.modulus import modulus_ratio, scaled
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.selection.mesh_convergence import at_limit
from arm_brachy.diagnosis.selection.problem import assemble
from arm_brachy.diagnosis.selection.screening import try_all
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.prove import recovery
from arm_brachy.prove.baselines import answers, gaussian_process
from arm_brachy.prove.folder import read_json, write_json
from arm_brachy.prove.outcome import planted
from arm_brachy.prove.plan import NULL, SINGLE
from arm_brachy.prove.totals import of_kind, share

SEED = 0    # of the meshes, as the detector's


def answer_all(folder, key, truths, workers, progress):
    """Case -> columns of `answer`; kept in a file.

    folder : TrialFolder;  key : of the sealed folders;  workers : Workers
    progress(stage, done, of)
    """
    held = read_json(folder / 'baselines.json') or {}
    lacking = [case for case in truths if case not in held]
    progress('baselines', 0, len(lacking))
    tasks = [(folder.given(case), folder.sealed(key, case) / 'heldout.npz', truths[case])
             for case in lacking]
    for done, (case, one) in enumerate(zip(lacking, workers.each(answer, tasks), strict=True),
                                       start=1):
        held[case] = one
        write_json(folder / 'baselines.json', held)
        progress('baselines', done, len(lacking))
    return held


def answer(path, heldout, truth):
    """What every baseline says of the recording in a folder, and how well a process predicts.

    Returns 'said': baseline -> cause, '' for none, {} if the recording cannot be compared; and
    'error_process': as `recovery.recover`'s errors, None without
    """
    try:
        problem, matched = problem_of(path / 'bag', path / 'scene.yaml')
    except ArmBrachyError:
        return {'said': {}, 'error_process': None}
    return {'said': answers(problem), 'error_process': process_error(matched, heldout, truth)}


def process_error(matched, heldout, truth):
    """Error of the recalibrated model with a Gaussian process for the rest; None if it has none.

    matched : match.Matched;  heldout : .npz as `recovery.recover` reads it
    """
    if truth['withheld'] or not truth['effects']:
        return None
    scene = matched.baseline.model.specimen.scene
    with np.load(heldout) as file:
        signals = {name: file[name] for name in file.files}
    try:
        return recovery.error(scene, signals, truth, scene.material.E / 1e3, (),
                              learnt=lambda kind, q: learn(matched, kind, q))
    except ArmBrachyError:
        return None


def learn(matched, kind, travels):
    """What a process adds (m, c, 3) to a stream at travels (m, p), 0 where the pads are at rest.

    It learns what is left of the model at the recording's states; a channel that was not seen at
    one has there what it has on average.
    """
    states, shown = matched.recorded.states, matched.baseline.shown[kind]
    stream = states.streams[kind]
    left = np.zeros_like(shown)
    names = channels_of(matched.baseline.model.specimen)[kind]
    at = [names.index(name) for name in stream.names]
    off = stream.values - shown[:, at]
    left[:, at] = np.where(np.isfinite(off), off, np.nanmean(off, axis=0))
    flat = left.reshape(len(left), -1)
    middle = flat.mean(axis=0)
    ends = np.vstack([travels, np.zeros(states.q.shape[1])])
    found = gaussian_process(states.q, flat - middle, ends)
    return (found[:-1] - found[-1]).reshape(len(travels), *shown.shape[1:])


def problem_of(bag, scene):
    """(judge.Problem, Matched) of one recording: no findings, no decision, no full fit.

    The problem at the limit of finer elements where the recording bears it out, as the detector's.
    """
    matched, finer = compared(bag, scene)
    tried = try_all([matched], occasions_of((matched.recorded,)))
    return assemble([finer], tried).problem, matched


def compared(bag, scene):
    """(Matched of a recording, the same at the limit of finer elements if that is borne out)."""
    evidence, = load_evidence([bag], load_scene(scene))
    recorded = look(evidence)
    specimen = specimen_of(evidence.scene)
    specimen = specimen_of(scaled(evidence.scene, modulus_ratio(recorded, specimen)),
                           specimen.mesh)
    ensemble = ensemble_of(ForwardModel(specimen), stream(SEED, 'meshes'))
    matched = match(recorded, specimen, ensemble, given((recorded,)).terms)
    return matched, (at_limit([matched], ensemble.limit) or [matched])[0]


def rows(truths, said):
    """Lines of a table from what `answer_all` returns.

    Of each baseline: top-1 on singles, false alarms on nulls, wrong claims on all, Wilson.
    """
    lines = []
    names = dict.fromkeys(name for one in said.values() for name in one['said'])
    for name in names:
        cases = [{'kind': truths[case]['kind'], 'said': one['said'].get(name),
                  'right': one['said'].get(name) in planted(truths[case])}
                 for case, one in said.items()]
        lines += [{'baseline': name, **share(what, some, counts)} for what, some, counts in (
            ('top-1, all singles', of_kind(cases, SINGLE), lambda c: c['right']),
            ('false alarms, nulls', of_kind(cases, NULL), lambda c: c['said'] != ''),
            ('wrong claims, all cases', cases, lambda c: c['said'] and not c['right']))]
    return tuple(lines)


def gain_row(named, gained):
    """What a Gaussian process recovers of what an oracle gains, beside `recovery.recover`'s.

    named : from `answer_all`;  gained : 'absolute/case' -> columns of `recovery.recover`
    """
    shares = []
    for case, one in named.items():
        errors = gained.get(f'absolute/{case}', {})
        if one['error_process'] is not None and errors.get('recovery') is not None:
            shares.append((errors['error_base'] - one['error_process'])
                          / (errors['error_base'] - errors['error_oracle']))
    return {'baseline': 'Gaussian process', 'what': 'held-out recovery',
            'median': float(np.median(shares)) if shares else None, 'unit': '1',
            'of': len(shares)}
