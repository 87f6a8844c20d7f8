"""Force along a needle in bovine liver, published, against the force law of devices.needle.

Okamura, Simone, O'Leary 2004 push a needle into liver: the capsule dents from about 9 mm of
travel, breaks at 19 mm, and cutting and friction follow until, from 27 mm, membranes within the
liver dent and break in their turn. Fitted is what the law describes, one capsule and the path
behind it, on every second point; the others are held out. The law has no membranes within: the
whole curve is shown and its error given without a goal. On so short a path the fit cannot tell
cutting from friction; it finds friction alone.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from arm_brachy.core.paths import share_dir
from arm_brachy.devices.needle import NeedleForce, NeedleParams
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.evaluation.style import INK, OURS, Plate, new_figure, styled

NAME = 'needle-force'
DATA = Path(__file__).parent / 'okamura_2004' / 'depth_force.csv'
SPEED = 3e-3         # m/s, of the insertion
RUPTURE = 19.15e-3   # m, depth of the highest force before the first drop; rounded to 0.01 mm
DROP = 0.1e-3        # m behind it that belong to the drop as drawn
NEXT = 27.5e-3       # m, where the force begins to rise towards the next rupture
GOAL = 0.15          # N
STEP = 1e-5          # m, of the simulated insertion


@dataclass(frozen=True)
class Fit:
    """A law fitted: NeedleParams, and where the skin is on the way of the tip [m]."""

    params: NeedleParams
    skin: float

    def force(self, depth):
        """Force (n,) [N] at depths (n,) [m] of one insertion at SPEED."""
        law, path = NeedleForce(self.params), np.arange(0.0, depth.max() + STEP, STEP)
        return np.interp(depth, path, [law.step(d, self.skin, SPEED) for d in path])


def law(values):
    """Return the Fit of skin [m], k1 [N/m], k2 [N/m^2], cutting [N], friction [N/m].

    The capsule breaks where it did: the force of rupture follows from its stiffness. At one speed
    viscous and Coulomb friction are one number.
    """
    skin, k1, k2, cutting, friction = values
    dent = RUPTURE + STEP - skin     # just beyond the last point of the rise
    return Fit(replace(NeedleParams(), dent_linear=k1, dent_square=k2, cutting=cutting,
                       coulomb=friction, viscous=0.0, puncture=k1 * dent + k2 * dent**2), skin)


def fit(depth, force):
    """Return the Fit that is nearest to forces (n,) [N] at depths (n,) [m], least squares."""
    scale = np.array([1e-2, 1e2, 1e4, 1.0, 1e2])
    found = least_squares(lambda v: law(v * scale).force(depth) - force,
                          np.array([0.9, 0.1, 1.0, 0.1, 0.2]), x_scale=0.1, diff_step=1e-3,
                          bounds=(np.zeros(5), [1.5, 10.0, 10.0, 2.0, 10.0]))
    return law(found.x * scale)


def published():
    """Depth (n,) [m] and force (n,) [N] of the published curve, ordered by depth."""
    depth, force = np.genfromtxt(DATA, delimiter=',', skip_header=4).T
    order = np.argsort(depth, kind='stable')
    return 1e-3 * depth[order], force[order]


def reproduce(out_dir):
    """Fit and compare; write JSON and PNG into `out_dir`. Returns evaluation.result.Result."""
    depth, force = published()
    clear = (depth <= RUPTURE) | (depth > RUPTURE + DROP)
    within = clear & (depth < NEXT)
    first, second = np.flatnonzero(within)[::2], np.flatnonzero(within)[1::2]
    best = fit(depth[first], force[first])
    parts = {'fitted points': first, 'held-out points': second,
             'whole curve, membranes within included': np.flatnonzero(clear)}
    rows = tuple({'part': name, 'points': len(at), 'rmse_N': _rmse(best, depth[at], force[at])}
                 for name, at in parts.items())
    error = rows[1]['rmse_N']
    p = best.params
    rows += ({'part': 'parameters', 'skin_mm': float(1e3 * best.skin),
              'dent_linear_N_m': float(p.dent_linear), 'dent_square_N_m2': float(p.dent_square),
              'puncture_N': float(p.puncture), 'cutting_N': float(p.cutting),
              'friction_N_m': float(p.coulomb)},)
    target = Target('RMSE, held-out points', error, 'N', f'<= {GOAL:g}', bool(error <= GOAL))
    result = Result(NAME, None, commit_of(share_dir()), str(machine_description()), rows,
                    (target,))
    result.to_json(Path(out_dir) / f'{NAME}.json')
    figure(depth, force, best).save(Path(out_dir) / f'{NAME}.png')
    return result


def _rmse(best, depth, force):
    return float(np.sqrt(np.mean((best.force(depth) - force)**2)))


@styled
def figure(depth, force, best):
    """Published and fitted force over depth."""
    sheet = new_figure(6.4, 3.6)
    axis = sheet.subplots()
    axis.plot(1e3 * depth, force, '.', color=INK, ms=3, label='published, bovine liver')
    fine = np.linspace(0.0, depth.max(), 2000)
    axis.plot(1e3 * fine, best.force(fine), color=OURS, lw=1.2, label='law, fitted left of the '
                                                                      'line')
    axis.axvline(1e3 * NEXT, color=INK, lw=0.6, ls=':')
    axis.set_xlabel('depth of the needle / mm')
    axis.set_ylabel('force / N')
    axis.legend(loc='upper left')
    return Plate(NAME, sheet, 'Needle: published and fitted force along it.')
