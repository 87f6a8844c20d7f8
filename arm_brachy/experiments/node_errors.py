"""By how much two good meshes disagree about what hangs on single nodes or points of quadrature.

A base that is loose within a radius is loose at whole nodes, a lump is stiff at whole points of
quadrature. Two meshes of the breast, with the pads' rims among their edges and of about one size,
are pushed with and without such a term, every pad alone and neighbours together. Its effect on one
mesh is compared with that on the other: how many times as large it is there (`scale`), and what it
differs by besides (`rest`, a share of it). `diagnosis.likelihood.constitutive_error` allows for
both. Test: experiments/test_node_errors.py
"""

import numpy as np

from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.registry import parse_terms

NAME = 'node-errors'
SCENES = config_dir() / 'scenes'
MESHES = ('breast_plant.msh', 'breast_rims.msh')    # 1963 and 2278 tetrahedra
ALONE, TOGETHER = 6e-3, 5e-3    # m, how deep
TERMS = {
    'loose base, 14 mm': {'name': 'base_debond', 'radius_mm': 14, 'centre_mm': [18, 4, 0]},
    'loose base, 20 mm': {'name': 'base_debond', 'radius_mm': 20, 'centre_mm': [18, 4, 0]},
    'loose base, 28 mm': {'name': 'base_debond', 'radius_mm': 28, 'centre_mm': [18, 4, 0]},
    'wall': {'name': 'obstacle', 'gap_mm': 0.05, 'centre_mm': [-13, -6, 57], 'radius_mm': 18},
    'lump': {'name': 'inclusion', 'radius_mm': 9, 'ratio': 5, 'centre_mm': [15, 5, 25]},
    'pad elsewhere': {'name': 'pad_misplacement', 'pads': ['pad_1'], 'side_mm': 2, 'up_mm': 1},
    # What hangs on no node:
    'gradient': {'name': 'stiffness_gradient', 'gradient_per_m': [8, 0, 0]},
    'skin': {'name': 'skin_layer', 'thickness_mm': 2, 'ratio': 8},
    'base on springs': {'name': 'base_compliance', 'tangential_kPa_mm': 1, 'normal_kPa_mm': 2},
    'weight': {'name': 'gravity', 'added_m_s2': [0, -2, 0]},
    'compressibility': {'name': 'compressibility', 'factor': 0.5},
    'stiffening': {'name': 'strain_stiffening', 'ratio': 1.0},
    'load': {'name': 'external_force', 'force_N': [0.2, 0.2, -0.3], 'centre_mm': [18, 10, 50],
             'radius_mm': 11},
}


def reproduce(out_dir):
    """Return the Result; no figures go to `out_dir`."""
    return Result(NAME, 0, commit_of(share_dir()), machine_description(), compared(TERMS))


def compared(terms):
    """A row (dict) for each of some TERMS, label -> scenario entry, and stream."""
    scene = load_scene(SCENES / 'breast.yaml')
    path = pushes(len(scene.pads))
    shown = [effects(specimen_of(with_mesh(scene, SCENES / 'breast' / mesh)), path, terms)
             for mesh in MESHES]
    return tuple({'term': label, 'stream': kind, **_differences(one[label][kind],
                                                                other[label][kind])}
                 for one, other in (shown,) for label in terms for kind in (OPTICAL, FORCE))


def pushes(pads):
    """transmission.Path of rest, every pad alone, and neighbours together."""
    single = np.eye(pads)
    depths = np.vstack([np.zeros(pads), ALONE * single,
                        TOGETHER * (single + np.roll(single, 1, axis=1))])
    return Path(np.arange(len(depths), dtype=float), depths)


def effects(specimen, path, terms):
    """Label -> kind -> (n, c, 3) SI, what each term changes."""
    plain = ForwardModel(specimen).predict(path, path.t)
    found = {label: ForwardModel(specimen, parse_terms([entry], NAME)).predict(path, path.t)
             for label, entry in terms.items()}
    return {label: {kind: one.get(kind) - plain.get(kind) for kind in (OPTICAL, FORCE)}
            for label, one in found.items()}


def _differences(one, other):
    scale = float(np.vdot(one, other) / np.vdot(one, one))
    return {'scale': scale,
            'rest': float(np.linalg.norm(other - scale * one) / np.linalg.norm(other))}
