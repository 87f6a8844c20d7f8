"""MuJoCo's flex on the push: St. Venant-Kirchhoff, so its equilibrium is another one.

A dynamic simulator finds rest by letting the motion die. Implicit steps far longer than any
period of the body do that fastest (`discrete` is the only integrator that takes a flex
implicitly). The time counted is that until every node stays within NEAR of MuJoCo's own
equilibrium.
"""

import mujoco
import numpy as np

from arm_brachy.experiments.peers.harness import (
    TIGHT,
    Diverged,
    main,
    peak_memory,
    timed,
)
from arm_brachy.experiments.peers.problem import Answer

NEAR = 1e-4          # m
TIME_STEP = 0.1      # s; from 0.01 to 1 s the number of steps is the same within one
MOST_STEPS = 300     # a body that moves after these does not come to rest
DENSITY = 1000.0     # kg/m^3; inertia is forgotten within a step
# The pad is a body: MuJoCo does not bond a flex to a moving frame. This mass no tissue moves.
PAD_MASS = 1e6       # kg
BODY = ('<body name="v{i}" pos="{at}"><inertial pos="0 0 0" mass="{mass}" '
        'diaginertia="1e-9 1e-9 1e-9"/><joint type="slide" axis="1 0 0"/>'
        '<joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/></body>')
MODEL = """<mujoco>
<option timestep="{step}" gravity="0 0 0" integrator="discrete"><flag contact="disable"/></option>
<size memory="1G"/>
<worldbody><body name="pad"><inertial pos="0 0 0" mass="{pad_mass}" diaginertia="1 1 1"/>
<joint type="slide" axis="{axis}"/></body>{bodies}</worldbody>
<deformable><flex name="tissue" dim="3" radius="1e-4" body="{names}" vertex="{vertices}"
element="{elements}"><contact selfcollide="none" contype="0" conaffinity="0"/>
<elasticity young="{E}" poisson="{nu}" damping="0"/></flex></deformable></mujoco>"""


def model(problem):
    """The MjModel of a Problem: free nodes slide along three axes, the pad along one."""
    free = np.setdiff1d(np.arange(len(problem.nodes)), problem.held)
    mass = dict(zip(free, _nodal_mass(problem)[free], strict=True))
    names, vertices = ['world'] * len(problem.nodes), [_text(at) for at in problem.nodes]
    for i in problem.pad:
        names[i] = 'pad'
    for i in free:
        names[i], vertices[i] = f'v{i}', '0 0 0'
    bodies = (BODY.format(i=i, at=_text(problem.nodes[i]), mass=mass[i]) for i in free)
    return mujoco.MjModel.from_xml_string(MODEL.format(
        step=TIME_STEP, pad_mass=PAD_MASS, bodies=''.join(bodies), names=' '.join(names),
        axis=_text(problem.push / np.linalg.norm(problem.push)), vertices=' '.join(vertices),
        elements=_text(problem.elements.ravel()), E=problem.E, nu=problem.nu))


def _text(numbers):
    return ' '.join(map(repr, numbers.tolist()))


def _nodal_mass(problem):
    corners = problem.nodes[problem.elements]
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    return np.bincount(problem.elements.ravel(), np.repeat(DENSITY * volume / 4.0, 4))


def settle(flex, problem, steps):
    """Node positions (steps, n, 3) [m] after each step from rest with the pad displaced at once.

    Ends early when no node moves by more than harness.TIGHT in a step.
    """
    data, seen = mujoco.MjData(flex), [problem.nodes]
    for _ in range(steps):
        data.qpos[0], data.qvel[0] = np.linalg.norm(problem.push), 0.0   # the pad's joint is first
        mujoco.mj_step(flex, data)
        seen.append(data.flexvert_xpos.copy())
        if np.abs(seen[-1] - seen[-2]).max() <= TIGHT:
            break
    return seen[1:]


def answer(problem):
    """The Answer of MuJoCo to a Problem of linear elements. Raises Diverged.

    Building the model, which is parsing text, is not counted.
    """
    flex = model(problem)
    seen = settle(flex, problem, MOST_STEPS)
    if len(seen) == MOST_STEPS:
        raise Diverged(f'the flex still moves after {MOST_STEPS} steps of {TIME_STEP} s')
    far = [np.linalg.norm(x - seen[-1], axis=1).max() > NEAR for x in seen]
    steps = 2 + max(k for k, one in enumerate(far) if one)
    found, cpu, wall = timed(lambda: settle(flex, problem, steps)[-1])
    return Answer(found, seen[-1], np.full(3, np.nan), cpu, wall, steps, 1, peak_memory(),
                  mujoco.__version__)


if __name__ == '__main__':
    main(answer)
