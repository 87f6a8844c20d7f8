"""Where the markers of a scene should be at given pad travel; those on tissue to first order.

Good enough to tell markers apart and to gate outliers; not an estimate of anything.
"""

import numpy as np

from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.scene import BASE, TISSUE
from arm_brachy.tissue.build import build_body, placement_mesh
from arm_brachy.tissue.contact_poses import ridden
from arm_brachy.tissue.jacobian import directed_jacobian
from arm_brachy.tissue.mesh import embed, interpolate
from arm_brachy.tissue.newton import StaticSolver


class MarkerMotion:
    """Markers of a scene as affine functions of pad travel, on the model side.

    names : m markers, all of the scene;  on_tissue, on_pad, on_base : (m,) bool
    rest : (m, 3) [m] at zero travel, the scene's own loads acting
    jacobian : (m, 3, p) d marker / d travel at zero travel [1]
    Tissue markers are off by what is not linear: some 20 % of their motion at 20 mm pushes.
    """

    def __init__(self, scene, terms=()):
        """scene : core.scene.Scene, mesh path absolute;  terms : BodyTerms.

        Raises NotConverged if the body has no equilibrium at rest, ConfigError without markers.
        """
        if not scene.markers:
            raise ConfigError(f'scene {scene.name}: no markers; an estimator needs some to see')
        self.names = tuple(m.name for m in scene.markers)
        carriers = [m.body for m in scene.markers]
        self.on_tissue = np.array([c == TISSUE for c in carriers])
        self.on_base = np.array([c == BASE for c in carriers])
        self.on_pad = ~(self.on_tissue | self.on_base)
        self.rest = np.array([m.position for m in scene.markers], dtype=float)
        plain = body = build_body(scene)
        for term in terms:
            body = term.prepare(body)
        self.jacobian = np.zeros((len(self.names), 3, len(body.pads)))
        for i, (pad, moved) in enumerate(zip(plain.pads, body.pads, strict=True)):
            riders = [c == pad.name for c in carriers]  # a term may have moved the pad at rest
            self.rest[riders] = ridden(self.rest[riders], *(
                (one.centre, one.direction) for one in (pad, moved)))
            self.jacobian[riders, :, i] = moved.direction
        self._place_tissue(scene, body, plain.mesh)

    def _place_tissue(self, scene, body, mesh):
        if not self.on_tissue.any():
            return
        solver = StaticSolver(body)
        still = np.zeros((len(body.pads), 3))
        state = solver.solve(body.mesh.nodes, still)
        if not state.outcome.ok:
            raise NotConverged(f'model of scene {scene.name} at rest: {state.outcome.advice}')
        names = [n for n, there in zip(self.names, self.on_tissue, strict=True) if there]
        embedding = embed(placement_mesh(mesh, body), self.rest[self.on_tissue], names=names)
        self.rest[self.on_tissue] = interpolate(embedding, state.x)
        self.jacobian[self.on_tissue] = directed_jacobian(solver, state.x, embedding)

    def at(self, q):
        """Positions (m, 3) [m] at travel q (p,) [m]."""
        return self.rest + self.jacobian @ np.asarray(q, dtype=float)
