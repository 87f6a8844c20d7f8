"""The model side of a scene as estimators need it: a SoftBody, and points that ride on it."""

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.scene import TISSUE
from arm_brachy.tissue.build import build_body, placement_mesh
from arm_brachy.tissue.mesh import embed


class ModelBody:
    """A body at rest with named markers and targets on it.

    scene : core.scene.Scene, mesh path absolute;  terms : body terms without memory
    targets, markers : names, in the order of every array; markers are on the tissue
    body : SoftBody;  directions : (p, 3) unit push directions
    target_rider, marker_rider : mesh.Embedding;  rest_targets, rest_markers : (k, 3) [m]
    Raises ConfigError for a term with memory, an unknown name or a marker not on the tissue,
    MeshError for a point off the body.
    """

    def __init__(self, scene, terms, targets, markers):
        plain = body = build_body(scene)
        for term in terms:
            body = term.prepare(body)
            if term.memory(body) is not None:
                raise ConfigError(f'model: term {term.spec.name} has memory; estimators take the '
                                  'tissue in equilibrium; remove it from model.terms')
        self.body = body
        self.targets, self.markers = tuple(targets), tuple(markers)
        self.directions = np.array([pad.direction for pad in body.pads]).reshape(-1, 3)
        mesh = placement_mesh(plain.mesh, body)
        self.rest_targets = _positions(scene, scene.targets, self.targets, 'target')
        self.rest_markers = _positions(scene, scene.markers, self.markers, 'marker')
        self.target_rider = embed(mesh, self.rest_targets, names=self.targets)
        self.marker_rider = embed(mesh, self.rest_markers, names=self.markers)

    def pad_displacement(self, q):
        """Displacements (p, 3) [m] of the pads at travel q (p,) [m]."""
        return np.asarray(q, dtype=float)[:, None] * self.directions


def _positions(scene, items, names, kind):
    known = {item.name: item for item in items}
    for name in names:
        if name not in known:
            raise ConfigError(f'scene {scene.name}: no {kind} {name!r}; it has: '
                              f'{", ".join(known) or "none"}')
        if getattr(known[name], 'body', TISSUE) != TISSUE:
            raise ConfigError(f'scene {scene.name}: {kind} {name} is on {known[name].body}; an '
                              'estimator of the inside takes markers on the tissue')
    return np.array([known[name].position for name in names], dtype=float).reshape(-1, 3)
