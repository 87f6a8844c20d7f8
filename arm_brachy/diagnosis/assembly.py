"""Recordings and hypotheses as one decide.Problem, and what was held out as errors in SI."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from arm_brachy.diagnosis.decide import Explanation, Problem
from arm_brachy.diagnosis.inference import posterior
from arm_brachy.diagnosis.statements import StreamFit


@dataclass(frozen=True)
class Assembly:
    """matched : Matched each;  tried : hypotheses.Tried;  problem : decide.Problem

    tests : (channel, feature) of every column of its structured tests
    names : of the columns of its U
    """

    matched: tuple
    tried: object
    problem: Problem
    tests: tuple
    names: tuple

    def hypothesis_of(self, explanation):
        """(Hypothesis, its Responses) of a decide.Explanation."""
        i = self.problem.explanations.index(explanation)
        return self.tried.hypotheses[i], self.tried.responses[i]


def assemble(matched, tried, sound=0):
    """Assembly of Matched recordings with the hypotheses that were tried on them.

    sound : how many of the last recordings are known to lack nothing: no cause acts there
    """
    matched = tuple(matched)
    acts = np.concatenate([np.full(len(m.r), float(i < len(matched) - sound))
                           for i, m in enumerate(matched)])
    U, names = _stacked(matched)
    tests, labels = _tests(matched)
    columns = (acts[:, None] * np.vstack([m.observables.whiten(r.per_prior())
                                          for m, r in zip(matched, responses, strict=True)])
               for responses in tried.responses)
    explanations = tuple(Explanation(one.name, label(one), part)
                         for one, part in zip(tried.hypotheses, columns, strict=True))
    problem = Problem(np.concatenate([m.r for m in matched]), U,
                      np.concatenate([m.kinds for m in matched]), tests, explanations)
    return Assembly(matched, tried, problem, labels, names)


def label(hypothesis):
    """Which actuator, marker, place or time, in words; '' if there is none."""
    return ', '.join(f'{key} {_shown(value)}' for key, value in hypothesis.place.items()
                     if np.size(value) and not isinstance(value, str) or value)


def _shown(value):
    if isinstance(value, str):
        return value
    return ' '.join(v if isinstance(v, str) else f'{v:.4g}' for v in np.atleast_1d(
        np.array(value, dtype=object)))


def _stacked(matched):
    """(U, names): nuisances of single recordings side by side, those of the set-up as one."""
    own = block_diag(*(m.U[:, m.own] for m in matched))
    shared = np.vstack([m.U[:, ~m.own] for m in matched])
    names = [name for m in matched for name, own in zip(m.nuisances.names, m.own, strict=True)
             if own]
    names += [n for n, own in zip(matched[0].nuisances.names, matched[0].own, strict=True)
              if not own]
    return np.hstack([own, shared]), tuple(names)


def _tests(matched):
    """Columns of structured tests, every feature in every channel of all recordings."""
    channels = list(dict.fromkeys((row.kind, row.channel, row.axis)
                                  for m in matched for row in m.observables.rows))
    blocks, names = [], []
    features = [_features(m) for m in matched]
    for name in features[0]:
        plain = []
        for m, feature in zip(matched, features, strict=True):
            values = {kind: np.broadcast_to(feature[name][:, None, None, None],
                                            (*shown.shape, 1))
                      for kind, shown in m.baseline.shown.items()}
            plain.append(m.observables.whiten(values)[:, 0])
        blocks.append(np.concatenate(plain))
        names.append(name)
    of_row = np.array([channels.index((row.kind, row.channel, row.axis))
                       for m in matched for row in m.observables.rows])
    columns = np.zeros((len(of_row), len(channels) * len(names)), dtype=np.float64)
    for j, block in enumerate(blocks):
        columns[np.arange(len(of_row)), of_row * len(names) + j] = block
    labels = tuple((channel, name) for channel in channels for name in names)
    alive = np.ptp(columns, axis=0) > 0.0
    return columns[:, alive], tuple(x for x, keep in zip(labels, alive, strict=True) if keep)


def _features(m):
    """Name -> (n,) what a missed effect may follow, each within -1 to 1."""
    states, labels = m.recorded.states, m.recorded.states.labels
    depth = states.q / max(np.abs(states.q).max(), 1e-9)
    deepest = depth.max(axis=1)
    span = states.t - states.t[0]
    speed = np.where(labels.direction != 0, labels.speed, 0.0)
    out = {'constant': np.ones(len(span)), 'time': span / max(span[-1], 1e-9),
           'direction': labels.direction * deepest, 'past_maximum': labels.past_maximum * deepest,
           'rate': deepest * speed / max(speed.max(initial=0.0), 1e-9),
           'hold': np.where(labels.direction == 0, deepest, 0.0) * np.exp(-labels.since),
           'rest': np.where(deepest < 0.02, np.exp(-labels.since), 0.0)}
    for i, column in enumerate(depth.T):
        if np.ptp(column):
            out[f'depth {i}'] = column
            out[f'depth^2 {i}'] = column**2
    return out


def held_out_fits(assembly, explanations):
    """statements.StreamFit of every stream: every kind of experiment predicted from the others.

    explanations : decide.Explanation that were accepted, () = none
    Nuisances count as known only from the other kinds as well.
    """
    problem = assembly.problem
    plain = np.concatenate([m.observables.difference(m.baseline.shown) for m in assembly.matched])
    sd = np.concatenate([m.observables.sd for m in assembly.matched])
    U = _plain_nuisances(assembly)
    causes = [_plain_columns(assembly, e) for e in explanations]
    given = np.zeros_like(plain)
    recalibrated = plain - _predicted(problem, problem.U, U)
    named = None
    if explanations:
        whitened = np.hstack([problem.U, *(e.columns for e in explanations)])
        named = plain - _predicted(problem, whitened, np.hstack([U, *causes]))
    streams = np.array([row.kind for m in assembly.matched for row in m.observables.rows])
    return tuple(StreamFit(kind, *(_rms(v[streams == kind]) for v in
                                   (plain - given, recalibrated, sd)),
                           None if named is None else _rms(named[streams == kind]),
                           'every kind of push in turn')
                 for kind in dict.fromkeys(streams.tolist()))


def _rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def _predicted(problem, whitened, plain):
    """(N,) SI: every kind predicted by the coefficients that the other kinds give."""
    out = np.zeros(len(problem.r))
    for kind in np.unique(problem.kinds):
        rows = problem.kinds == kind
        fit = posterior(whitened[~rows], problem.r[~rows])
        out[rows] = plain[rows] @ fit.mean
    return out


def _plain_nuisances(assembly):
    parts = [m.observables.rows_of(m.nuisances.values) for m in assembly.matched]
    own = block_diag(*(p[:, m.own] for p, m in zip(parts, assembly.matched, strict=True)))
    return np.hstack([own, np.vstack([p[:, ~m.own] for p, m in
                                      zip(parts, assembly.matched, strict=True)])])


def _plain_columns(assembly, explanation):
    _, responses = assembly.hypothesis_of(explanation)
    return np.vstack([m.observables.rows_of(r.per_prior())
                      for m, r in zip(assembly.matched, responses, strict=True)])
