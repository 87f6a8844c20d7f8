"""What markers, targets and force sensors show as a function of the travel of the pads."""
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from arm_brachy.prove.generator.probe import Probes
from arm_brachy.prove.generator.solver import NotSolved, State

LEVELS = (0.0, 1 / 3, 2 / 3, 1.0)
PAIR_LEVEL = 2
PART = 0.08     # of a pad's travel, that two meshes may differ by at a point (beside rims: 0.05)
FOLLOWS = 2.0   # times as far as a pad that goes ahead, tissue moves at most, unless it creases:
                # 1.3 by a rim where two meshes agree, 3.5 where it snapped


@dataclass(frozen=True)
class Response:
    """Table over pads pushed alone, and the excess of pairs of them pushed together.

    strokes (p,) [m]; levels (l,) shares of the stroke; alone (p, l, o) and rest (o,) outputs:
    displacements of the probes, then forces on the pads, flattened [m, N]; pairs (k, 2);
    coupling (k, o): excess of a pair over the sum of its pads, per product of travel [1/m^2].
    kinked : monotone interpolation, for contact that opens or closes on the way.

    Third-order coupling is left out; `test_response` shows by how much that errs.
    """

    strokes: np.ndarray
    levels: tuple
    rest: np.ndarray
    alone: np.ndarray
    pairs: tuple
    coupling: np.ndarray
    kinked: bool = False

    def read(self, y):
        """Outputs (t, o) at travels y (t, p) [m]; levels are extended beyond both ends."""
        kind = PchipInterpolator if self.kinked else CubicSpline
        out = np.repeat(self.rest[None], len(y), 0)
        for i, stroke in enumerate(self.strokes):
            out += kind(stroke * np.array(self.levels), self.alone[i] - self.rest,
                        extrapolate=True)(y[:, i])
        for (i, j), excess in zip(self.pairs, self.coupling, strict=True):
            out += (y[:, i] * y[:, j])[:, None] * excess
        return out

    def split(self, out):
        """Displacements (t, k, 3) and forces (t, p, 3) of outputs (t, o)."""
        cut = 3 * len(self.strokes)
        return out[:, :-cut].reshape(len(out), -1, 3), out[:, -cut:].reshape(len(out), -1, 3)

    def less(self, other, *, kinked):
        """This response less `other`, of the same levels and pairs."""
        return replace(self, rest=self.rest - other.rest, alone=self.alone - other.alone,
                       coupling=self.coupling - other.coupling, kinked=kinked)


def outputs(model, probes: Probes, state):
    """Outputs (o,) of one state, in the order of `Response`."""
    return np.r_[probes.read(state.u + model.grid.offset).ravel(), model.pad_forces(state).ravel()]


def solve_response(model, probes, pairs, levels=LEVELS, guess=None):
    """`Response` of `model`, and its states, in order: pads by levels, then pairs.

    guess : states of another model on the same grid at the same travels, each the start of the
    state here; without them, paths are followed from rest.
    Raises NotSolved, also where the tissue creases: what is in between levels is then unknown.
    """
    strokes = np.array([pad.stroke for pad in model.pads])
    unit = np.diag(strokes)
    rest = model.follow(guess[0][0] if guess else model.rest(), np.zeros(len(strokes)))
    states = [[rest] for _ in strokes]
    for i in range(len(strokes)):
        for k, level in enumerate(levels[1:], 1):
            near = shifted(guess[i][k], guess[i][0], rest) if guess else None
            states[i].append(smooth(states[i][-1], reach(model, states[i][-1], near,
                                                         level * unit[i])))
    table = np.array([[outputs(model, probes, s) for s in row] for row in states])
    together = [pair_state(model, states, i, j, guess[-1][k] if guess else None)
                for k, (i, j) in enumerate(pairs)]
    coupling = np.array([
        (outputs(model, probes, s) - table[i, PAIR_LEVEL] - table[j, PAIR_LEVEL] + table[0, 0])
        / (s.y[i] * s.y[j]) for (i, j), s in zip(pairs, together, strict=True)])
    coupling = coupling.reshape(len(pairs), table.shape[-1])
    return (Response(strokes, tuple(levels), table[0, 0], table, tuple(pairs), coupling),
            [*states, together])


def smooth(before, state):
    """The state that follows `before`; raises NotSolved where tissue has jumped from there."""
    ahead = np.abs(state.y - before.y).max()
    far = np.linalg.norm(state.u - before.u, axis=1).max()
    if far > FOLLOWS * ahead:
        raise NotSolved(f'tissue jumps by {far} m as a pad goes ahead by {ahead} m')
    return state


def refuse_apart(fine, coarse):
    """Raise NotSolved if the tables of two meshes of a body part by more than their errors.

    fine, coarse : `Response` of the same pads and points, pads alone at their full stroke
    """
    for i, stroke in enumerate(fine.strokes):
        moved = [r.split((r.alone[i, -1] - r.rest)[None])[0][0] for r in (fine, coarse)]
        apart = np.linalg.norm(moved[0] - moved[1], axis=1)
        if apart.max() > PART * stroke:
            raise NotSolved(f'two meshes part by {apart.max()} m at point {apart.argmax()} under '
                            f'a push of {stroke} m')


def shifted(state, its_rest, rest):
    """State of another model, by as much off as the rests differ."""
    return State(state.y, state.u + rest.u - its_rest.u, state.p + rest.p - its_rest.p)


def reach(model, before, near, y):
    """State at y from `near`, a guess there, or else along the path from `before`."""
    if near is not None:
        try:
            return model.newton(near, y)
        except NotSolved:
            pass
    return model.follow(before, y)


def pair_state(model, states, i, j, near):
    """State with pads i and j at `PAIR_LEVEL`, from `near` or from the sum of either alone."""
    one, two, rest = states[i][PAIR_LEVEL], states[j][PAIR_LEVEL], states[0][0]
    start = State(one.y + two.y, one.u + two.u - rest.u, one.p + two.p - rest.p)
    if near is not None:
        return reach(model, start, near, start.y)
    try:
        return model.newton(start, start.y)
    except NotSolved:
        return model.follow(one, start.y)
