"""What a probe that presses on the skin does to a target, foretold by the controller's model.

3 N over a target 31 mm deep move it by 3.1 mm, more than a needle can be steered on the last of
its way: the needle's path is planned to where the target will then be.
Test: control/test_probe_press.py
"""

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.tissue.build import build_body, placement_mesh, target_points
from arm_brachy.tissue.instruments import Instruments, Tools
from arm_brachy.tissue.mesh import embed, interpolate
from arm_brachy.tissue.simulator import TissueSimulator

_STEP = 1e-3    # m of the way into the skin: the force grows by a quarter of a newton
_DT = 0.05      # s of one; the model has no memory, any would do


def pressed(scene, terms, target, R, p, *, force, face, deepest):
    """Return (3,) [m] by which a target moves under a probe, every pad at home.

    scene : core.scene.Scene of the model;  terms : BodyTerms without memory;  target : name
    R (3, 3), p (3,) [m] : of the probe, z out of the face into the tissue, p on the skin
    force : [N] along z;  face : probe_face.ProbeFace
    deepest : [m] into the skin as far as the probe goes, whatever the force is there
    Raises NotConverged where the model has no equilibrium under the probe. Left out: that the
    pads do not stay at home, and how the needle drags the tissue.
    """
    body = build_body(scene)
    sim = TissueSimulator(body, terms, instruments=Instruments(face))
    sim.settle()
    names, points = target_points(scene)
    inside = embed(placement_mesh(body.mesh, sim.body), [points[names.index(target)]])
    home, along = np.zeros((len(body.pads), 3)), R[:, 2]
    felt, at = [0.0], [interpolate(inside, sim.state.x)[0]]
    for depth in np.arange(0.0, deepest + _STEP, _STEP):
        state = sim.step(_DT * len(at), home, Tools(probe=(R, p + along * depth)))
        if not state.outcome.ok:
            raise NotConverged(f'model under a probe {1e3 * depth:.0f} mm in the skin: '
                               f'{state.outcome.advice}, or plan without it: procedure: '
                               '{foresee: false}')
        felt.append(-float(along @ state.instruments.probe.wrench[:3]))
        at.append(interpolate(inside, state.x)[0])
        if felt[-1] >= force:
            break
    if felt[-1] < force:        # the probe retracts there
        return at[-1] - at[0]
    share = (force - felt[-2]) / (felt[-1] - felt[-2])
    return at[-2] + share * (at[-1] - at[-2]) - at[0]
