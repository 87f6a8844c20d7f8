"""Recordings and hypotheses as one judge.Problem."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from arm_brachy.diagnosis.likelihood.discretisation import NAMES
from arm_brachy.diagnosis.likelihood.nuisances import MODULUS
from arm_brachy.diagnosis.likelihood.null_calibration import set_up_of
from arm_brachy.diagnosis.results.channels import whereabouts
from arm_brachy.diagnosis.selection.judge import Explanation, Problem
from arm_brachy.diagnosis.selection.misfit_tests import in_directions, structured_tests
from arm_brachy.diagnosis.statistics.linear_gaussian import posterior

PART = 0.2      # of the deepest, for a push to count; wobble at rest reaches some hundredths


@dataclass(frozen=True)
class Assembly:
    """matched : Matched each;  tried : screening.Tried;  problem : judge.Problem

    tests : label of every column of its structured tests
    names : of the columns of its U;  sound : how many of the last recordings lack nothing
    """

    matched: tuple
    tried: object
    problem: Problem
    tests: tuple
    names: tuple
    sound: int = 0

    @cached_property
    def suspects(self):
        """Matched of the recordings that may lack something, the set-up as well known as by all
        that lack nothing.
        """
        return tuple(map(self.put_right, self.matched[:len(self.matched) - self.sound]))

    def put_right(self, m):
        """A Matched of the same set-up, that as well known as by recordings that lack nothing."""
        return m if self._set_up is None else self._set_up.put_right(m)

    @cached_property
    def _set_up(self):
        nulls = self.matched[len(self.matched) - self.sound:]
        return set_up_of(nulls, *stacked_nuisances(nulls)) if nulls else None

    def hypothesis_of(self, explanation):
        """(Hypothesis, its Responses) of a judge.Explanation."""
        i = next(i for i, one in enumerate(self.problem.explanations) if one is explanation)
        return self.tried.hypotheses[i], self.tried.responses[i]


def assemble(matched, tried, sound=0):
    """Assembly of Matched recordings with the hypotheses that were tried on them.

    sound : how many of the last recordings are known to lack nothing: no cause acts there
    """
    matched = tuple(matched)
    acts = np.concatenate([np.full(len(m.r), float(i < len(matched) - sound))
                           for i, m in enumerate(matched)])
    U, names = stacked_nuisances(matched, sound)
    tests, labels = structured_tests(matched)
    columns = (acts[:, None] * np.vstack([m.observables.whiten(r.per_prior())
                                          for m, r in zip(matched, responses, strict=True)])
               for responses in tried.responses)
    pads = matched[0].baseline.model.specimen.pads
    explanations = tuple(Explanation(one.name, whereabouts(one.cls, one.place, pads), part,
                                     load_cases=one.cls.spec.load_cases,
                                     one_sided=tuple(s.one_sided for s in one.strengths),
                                     channel=carried_by(one))
                         for one, part in zip(tried.hypotheses, columns, strict=True))
    problem = Problem(np.concatenate([m.r for m in matched]), U,
                      np.concatenate([m.kinds for m in matched]), tests, explanations,
                      load_cases(matched, sound), in_directions(labels))
    return Assembly(matched, tried, problem, labels, names, sound)


def load_cases(matched, sound=0):
    """(N,) number of the load case of every row of Matched recordings; -1 = none.

    A load case is a set of pads that are pushed together: a push goes PART as deep as the deepest
    of all, a pad in it as the deepest at the time. The last `sound` recordings have none, as no
    cause acts there.
    """
    suspects = matched[:len(matched) - sound]
    q = np.abs(np.vstack([m.recorded.states.q for m in suspects]))
    depth = q.max(axis=1, initial=0.0)
    _, number = np.unique(q > PART * depth[:, None], axis=0, return_inverse=True)
    of_state = np.where(depth > PART * depth.max(initial=0.0), number.ravel(), -1)
    ends = np.cumsum([0, *(len(m.recorded.states.t) for m in suspects)])
    rows = [of_state[first:][m.observables.states]
            for first, m in zip(ends[:-1], suspects, strict=True)]
    return np.concatenate([*rows, *(np.full(len(m.r), -1) for m in matched[len(suspects):])])


def carried_by(hypothesis):
    """Actuators, sensors, markers or streams that carry an effect; empty if none does, or all.

    What metal or a weight is fixed to says where it is, and is no channel.
    """
    out = set()
    for key in ('actuators', 'pads', 'marker', 'markers', 'tools', 'stream'):
        one = hypothesis.place.get(key, ())
        out |= {(key.removesuffix('s'), name)
                for name in (one if isinstance(one, tuple) else (one,))}
    return frozenset(out)


def stacked_nuisances(matched, sound=0):
    """(U, names): nuisances of single recordings side by side, those of the set-up as one.

    The modulus of the last `sound` recordings is one of their own: tissue dries, warms and is cast
    anew, which calibration takes up, and no cause is to stand for it.
    """
    own = block_diag(*(m.U[:, m.own] for m in matched))
    shared = np.vstack([m.U[:, ~m.own] for m in matched])
    names = [name for m in matched for name, own in zip(m.nuisances.names, m.own, strict=True)
             if own]
    names += [n for n, own in zip(matched[0].nuisances.names, matched[0].own, strict=True)
              if not own]
    if sound:
        shared, names = _with_modulus_of_nulls(matched, sound, shared, names)
    return np.hstack([own, shared]), tuple(names)


def _with_modulus_of_nulls(matched, sound, shared, names):
    """Shared columns (N, k + 1) and all names, the modulus split between suspects and nulls."""
    null = np.concatenate([np.full(len(m.r), i >= len(matched) - sound)
                           for i, m in enumerate(matched)])
    column = shared[:, names.index(MODULUS) - len(names)]
    rest = np.where(null, column, 0.0)
    shared = shared.copy()
    shared[null, names.index(MODULUS) - len(names)] = 0.0
    return np.column_stack([shared, rest]), [*names, 'modulus_of_nulls']


def left_over(assembly, explanations, *, mesh=False):
    """(N,) what is left of the residual with nuisances and explanations at their best.

    mesh : what the mesh is wrong by is fitted, and left in
    """
    problem = assembly.problem
    U = np.hstack([problem.U, *(e.columns for e in explanations)])
    best = posterior(U, problem.r).mean
    if mesh:
        best[:len(assembly.names)][np.isin(assembly.names, NAMES)] = 0.0
        return problem.r + np.concatenate([m.of_mesh for m in assembly.matched]) - U @ best
    return problem.r - U @ best
