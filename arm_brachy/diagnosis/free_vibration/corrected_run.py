"""A run that lets a body go as a recording did: when, for how long, with the damping it showed.

Test: diagnosis/test_free_run.py
"""

from dataclasses import replace

from arm_brachy.diagnosis.free_vibration.damping import unknown, with_damping
from arm_brachy.diagnosis.free_vibration.look import Look
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.scenario import Overlay

TICK = 10e-3        # s: a body that rings at 10 Hz is looked at ten times a period
MESH_RATE = 20.0    # Hz: its shape twice a period


def as_let_go(base, evidences, shown):
    """A Scenario that repeats loading.Evidence number `shown` of `evidences`; else as `base`.

    base : scenario.Scenario on the scene of that recording. Damping that the scene lacks is that
    of the recordings, of this scene where it rings, else of all; both overlays carry it.
    Raises RecordingError if nothing was let go in one of them.
    """
    looks = [Look(prepare(one)) for one in evidences]
    release, scene = looks[shown].release, looks[shown].scene
    start, end = evidences[shown].span
    damped = with_damping(looks, {scene.name: scene})[scene.name]
    side = Overlay(rayleigh_alpha=damped.rayleigh_alpha, rayleigh_beta=damped.rayleigh_beta) \
        if unknown(scene) and not unknown(damped) else Overlay()
    return replace(base, tick=TICK, mesh_rate=MESH_RATE, release=float(release.t - start),
                   settle=float(end - release.t), plant=side, model=side)
