"""How far a body with pads may swing, and drag, where its model has no inertia.

About rest, with u = G q + Phi eta, G (free coordinates by pads) how the body follows pads that go
slowly by q and Phi its modes between them, a mode of w and damping ratio z moves as

    eta'' + 2 z w eta' + w^2 eta = -Phi' (M G q'' + alpha M G q'),

so that a corner of the path, a jump of velocity, sets it swinging about where it would rest
(Clough & Penzien 1993, Dynamics of Structures, ch. 12 and 27). How far, not which way: a phase is
lost after some periods, as no model knows w to better than a few per cent. That is allowed for in
every state, as what a model does not know.
Test: diagnosis/forward/test_inertia.py (against integration in time)
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.diagnosis.likelihood.observation import channels_of
from arm_brachy.diagnosis.model.specimen import attach, specimen_of
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.modes import modes_of
from arm_brachy.tissue.newton import StaticSolver

MODES = 40          # lowest ones: higher ones swing less, by one over their frequency
DAMPED = 0.02       # least damping ratio: that of a stiff gel. Without any all swings for ever
NOTE = ('The scene has inertia (dynamics: implicit), the model of a body with pads has not. How '
        'far the body may swing after its pads change speed is allowed for in every state: up to '
        '{:.2g} mm and {:.2g} N; so is what reads as a clock that is off by {:.2g} ms.')
SEEN = 0.05     # of readings in which a swing exceeds the noise, for it to be spoken of
HINT = ('The scene is quasi-static; a body of its density and modulus may swing by up to {:.2g} '
        'mm and {:.2g} N after its pads change speed. If it does, dynamics: implicit with its '
        'damping in the scene has that allowed for.')


@dataclass(frozen=True)
class Inertia:
    """What swings, of a specimen.Specimen.

    pole : (j,) [1/s] complex, of every mode;  drive : (j, p) by a pad's velocity
    shapes : kind -> (c, 3, j) SI by a mode;  drag : kind -> (c, 3, p) SI per m/s of a pad
    """

    pole: np.ndarray
    drive: np.ndarray
    shapes: dict
    drag: dict

    @property
    def lag(self):
        """[s] by which readings may come late or early: a radian of the slowest mode."""
        return 1.0 / float(np.abs(self.pole).min())

    def swing(self, motion, states):
        """How far readings may be from those of a body without inertia: kind -> (m, c) SI.

        motion : motion.Motion, its columns all pads;  states : load_states.LoadStates
        Every mode at its largest since the last corner, less what a window averages out.
        """
        jumps = np.diff(motion.velocity, axis=0, prepend=0.0, append=0.0)
        now, after = np.zeros(len(self.pole), dtype=complex), []
        for dt, jump in zip(np.diff(motion.t, prepend=motion.t[0]), jumps, strict=True):
            now = now * np.exp(self.pole * dt) + self.drive @ jump / self.pole.imag
            after.append(now)
        begin = states.t - 0.5 * states.width
        last = np.searchsorted(motion.t, begin + 1e-9, side='right') - 1
        since = np.maximum(begin - motion.t[np.maximum(last, 0)], 0.0)
        size = np.abs(np.array(after)[last]) * np.exp(np.outer(since, self.pole.real))
        size[last < 0] = 0.0
        turns = np.outer(states.width, np.abs(self.pole))
        size *= np.minimum(1.0, 2.0 / np.maximum(turns, 1e-12))
        drag = {kind: np.einsum('cap,mp->mca', one, states.velocity)
                for kind, one in self.drag.items()}
        return {kind: np.sqrt(np.einsum('caj,mj->mc', shape ** 2, size ** 2))
                + np.linalg.norm(drag[kind], axis=2) for kind, shape in self.shapes.items()}


def inertia_of(specimen):
    """The Inertia of a specimen.Specimen; None for a quasi-static scene."""
    return None if specimen.scene.dynamics == 'quasi_static' else _swinging(specimen)


def _swinging(specimen):
    """The Inertia of a specimen.Specimen, whatever its scene says of it."""
    body, solver = specimen.body, StaticSolver(specimen.body)
    n, p = len(body.mesh.nodes), len(body.pads)
    modes = modes_of(solver, body.mesh.nodes, StepFields.of(body), MODES)
    held = np.zeros((n, 3, p))
    for i, pad in enumerate(body.pads):
        held[pad.nodes, :, i] = specimen.directions[i]
    G, K = held.reshape(3 * n, p), modes.stiffness
    G[modes.dofs] = modes.factor.solve(-(K[modes.dofs] @ G))
    w, (alpha, beta) = np.sqrt(modes.square), body.damping
    ratio = np.maximum(0.5 * (alpha / w + beta * w), DAMPED)
    pole = -ratio * w + 1j * w * np.sqrt(np.maximum(1.0 - ratio ** 2, DAMPED))
    drive = -(modes.shapes.T @ (modes.mass[modes.dofs] @ G))
    full = np.zeros((3 * n, len(w)))
    full[modes.dofs] = modes.shapes
    shapes = _shown(specimen, full, K @ full)
    lag = alpha * drive / modes.square[:, None]
    drag = {kind: shape @ lag for kind, shape in shapes.items()}
    drag[FORCE] = drag[FORCE] + beta * _on_pads(body, K @ G)
    return Inertia(pole, drive, shapes, drag)


def with_swing(measured, swing, channels):
    """observables.Measured each with how far the body may swing, state by state, as their own.

    swing : kind -> (m, c) SI (`Inertia.swing`);  channels : kind -> names of its c
    """
    out = []
    for stream in measured:
        index = [channels[stream.kind].index(name) for name in stream.names]
        out.append(replace(stream, own=np.hypot(stream.own,
                                                swing[stream.kind][:, index, None])))
    return tuple(out)


def with_lag(calibration, scene):
    """The finding.Calibration of a core.scene.Scene with pads: what swings is late or early."""
    if scene.dynamics == 'quasi_static':
        return calibration
    calibration, lag = calibration or Calibration(), inertia_of(specimen_of(scene)).lag
    return replace(calibration, clock=float(np.hypot(calibration.clock, lag)))


def said(matched, calibration):
    """The note on Matched of a body with inertia whose model has none; () if it has none.

    calibration : finding.Calibration `with_lag`
    """
    swings = [m.swing for m in matched if m.swing]
    return (NOTE.format(*_largest(swings), 1e3 * calibration.clock),) if swings else ()


def hint(matched):
    """The note on Matched of a quasi-static scene whose body may swing all the same; else ()."""
    specimen = matched[0].baseline.model.specimen
    if specimen.scene.dynamics != 'quasi_static':
        return ()
    inertia = _swinging(specimen)
    swings = [inertia.swing(m.recorded.prepared.motion, m.recorded.states) for m in matched]
    channels = channels_of(specimen)
    seen = [swing[stream.kind][:, channels[stream.kind].index(name)] > stream.sd[:, c].max(axis=1)
            for m, swing in zip(matched, swings, strict=True) for stream in m.observables.measured
            for c, name in enumerate(stream.names)]
    return (HINT.format(*_largest(swings)),) if np.concatenate(seen).mean() > SEEN else ()


def _largest(swings):
    """(mm, N) of kind -> (m, c) SI each."""
    far, strong = (max(np.max(one[kind], initial=0.0) for one in swings for kind in kinds)
                   for kinds in ((OPTICAL, EM), (FORCE,)))
    return 1e3 * far, strong


def _shown(specimen, moved, balance):
    """kind -> (c, 3, j) SI of displacements moved (3n, j) whose internal forces are `balance`."""
    attached, n = attach(specimen, specimen.body), len(specimen.mesh.nodes)
    points = np.stack([attached.matrix(n) @ moved[axis::3] for axis in range(3)], axis=1)
    markers = len(specimen.markers)
    return {OPTICAL: points[:markers], EM: points[markers:],
            FORCE: _on_pads(specimen.body, balance)}


def _on_pads(body, balance):
    """(p, 3, j) [N] of the tissue on every pad, of internal forces (3n, j)."""
    forces = balance.reshape(-1, 3, balance.shape[1])
    return -np.stack([forces[pad.nodes].sum(axis=0) for pad in body.pads])
