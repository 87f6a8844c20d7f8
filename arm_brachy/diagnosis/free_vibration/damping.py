"""Damping of a released body where its scene has none: it is not known, so recordings tell it.

A body that rings has damping; a scene without any says nothing of it. It is then calibration, as
the modulus is: the ratio that a recording shows, shared by mass and stiffness equally, as one
frequency cannot tell them apart.
Test: diagnosis/test_free_body.py
"""

from dataclasses import replace

import numpy as np


def unknown(scene):
    """True for a core.scene.Scene without damping."""
    return not scene.rayleigh_alpha and not scene.rayleigh_beta


def with_damping(looks, scenes):
    """name -> core.scene.Scene, those without damping with that of the recordings.

    looks : look.Look of any of the scenes, name -> Scene. Where none rings the scene stays.
    """
    rung = [look.release.ring for look in looks if look.release.ring is not None]
    if not rung or not any(map(unknown, scenes.values())):
        return scenes
    return {name: _damped(scene, [look.release.ring for look in looks if look.scene.name == name
                                  and look.release.ring is not None] or rung)
            if unknown(scene) else scene for name, scene in scenes.items()}


def _damped(scene, rings):
    ratio = float(np.mean([ring.damping for ring in rings]))
    w = 2.0 * np.pi * float(np.mean([ring.frequency for ring in rings]))
    return replace(scene, rayleigh_alpha=ratio * w, rayleigh_beta=ratio / w)


def said(scene):
    """The note on a Scene that got its damping from recordings."""
    return (f'Scene {scene.name} has no damping: what the recordings show is taken, '
            f'rayleigh_alpha_per_s: {scene.rayleigh_alpha:.3g} and rayleigh_beta_ms: '
            f'{1e3 * scene.rayleigh_beta:.3g}, each half of it; corrected.yaml has them. Write '
            'them into the scene too, or what you measured.')
