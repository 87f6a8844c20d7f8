"""What the controller believes about the tissue: finite elements in equilibrium."""

import numpy as np

from arm_brachy.control.model import ModelState
from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.build import build_body, placement_mesh, target_points
from arm_brachy.tissue.jacobian import directed_jacobian
from arm_brachy.tissue.mesh import embed, interpolate
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.resting import rest


class TissueModel:
    """Quasi-static finite elements: equilibrium at the pads' travel, Jacobian (3.23) there.

    Each solve starts from the last good one, so answers depend on history only within the
    solver's tolerance (1e-10 m). Valid while the tissue is in equilibrium: pads move slowly.
    """

    def __init__(self, scene, terms=(), *, options=None):
        """Build the model of a scene.

        scene : core.scene.Scene, mesh path absolute;  terms : BodyTerms without memory
        options : NewtonOptions.  Raises ConfigError for a term with memory, which no equilibrium
        has, MeshError for a target outside the body.
        """
        body = build_body(scene)
        mesh = body.mesh
        for term in terms:
            body = term.prepare(body)
            if term.memory(body) is not None:
                raise ConfigError(f'model: term {term.spec.name} has memory; the model that the '
                                  'controller uses is quasi-static; remove it from model.terms')
        self.targets, positions = target_points(scene)
        self._solver = StaticSolver(body, options=options)
        self._directions = np.array([pad.direction for pad in body.pads]).reshape(-1, 3)
        mesh = placement_mesh(mesh, body)
        self._embedding = {name: embed(mesh, [point], names=[name])
                           for name, point in zip(self.targets, positions, strict=True)}
        start = rest(self._solver, body.mesh.nodes, np.zeros_like(self._directions))
        if not start.outcome.ok:
            raise NotConverged(f'model of scene {scene.name} at rest: {start.outcome.advice}')
        self._rest = self._x = start.x

    def rest(self, target):
        """Position (3,) [m] of a target at zero travel, the scene's own loads acting.

        target : name
        """
        return interpolate(self._embedding[target], self._rest)[0]

    def evaluate(self, q, target):
        """Return ModelState of a target; after a failed solve the next starts where this did.

        q : (p,) [m] pad travel along each push direction;  target : name
        """
        held_at = self._solver.held_positions(q[:, None] * self._directions)
        solution = self._solver.follow(self._x, held_at)
        if not solution.outcome.ok:
            return self._failed(solution.outcome)
        embedding = self._embedding[target]
        try:
            jacobian = directed_jacobian(self._solver, solution.x, embedding)[0]
        except NotConverged:
            return self._failed(Outcome.NOT_CONVERGED)
        self._x = solution.x
        return ModelState(interpolate(embedding, solution.x)[0], jacobian)

    def _failed(self, outcome):
        p = len(self._directions)
        return ModelState(np.full(3, np.nan), np.full((3, p), np.nan), outcome)
