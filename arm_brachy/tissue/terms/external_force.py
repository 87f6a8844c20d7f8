"""A force on the surface for a while: a touch, a cable, an instrument that leans on the tissue."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.mesh import boundary_faces, face_middles

DIVISIONS = 16  # of a face's edges: 256 points per face, so that a 2 mm touch meets an 8 mm face


@dataclass(frozen=True)
class ExternalForce(BodyTerm):
    """A dead load on a round patch of the free surface, from `onset` on for `duration`.

    Symbols: F `force`, c `centre`, R `radius`, t_0 `onset`, T `duration`, b(s) = (1 - s^2)^2 below
    s = 1. The traction is F b(|X - c| / R) over its own integral, so that the force is F whatever
    the mesh, and moves smoothly with the centre; the nodes get it by their shape functions
    (work-equivalent). It acts on material points and keeps its direction while they move.
    Test: tissue/terms/test_external_force.py (bar, reciprocity, window)
    """

    force: tuple = quantity(
        [0.0, 0.0, 0.0], 'N', 'force on the tissue, world frame', shape=(3,), low=-50.0, high=50.0,
        prior=('normal', 0.0, 0.5), typical=0.4,
        source='a light touch or a cable of 40 g (engineering judgement); limits wider',
        neutral=0.0)
    centre: tuple = quantity(
        [0.0, 0.0, 58.0], 'mm', 'where it acts, on the surface at rest, world frame', shape=(3,),
        low=-500.0, high=500.0, source='top of a 58 mm breast phantom')
    radius: float = quantity(
        10.0, 'mm', 'radius of the patch', low=2.0, high=100.0, prior=('lognormal', 10.0, 1.5),
        source='a fingertip (engineering judgement)')
    onset: float = quantity(
        0.0, 's', 'time after which it acts', low=0.0, high=1e5, prior=('uniform', 0.0, 60.0),
        source='the start of the run, or any time in its first minute')
    duration: float = quantity(
        2.0, 's', 'how long it acts', low=1e-3, high=1e5, prior=('lognormal', 2.0, 2.0),
        source='a touch of 2 s (engineering judgement)')

    spec: ClassVar[TermSpec] = TermSpec(
        name='external_force', kind=Kind.BOUNDARY, stage=Stage.BODY, timed=True,
        summary='something presses on the surface for a while',
        equation='f_a(t) = F int N_a b(|X - c| / R) dA / int b(|X - c| / R) dA for '
                 't_0 < t <= t_0 + T, else 0',
        source='work-equivalent nodal loads: Zienkiewicz & Taylor 2000, The Finite Element '
               'Method, vol. 1; b: biweight kernel (Silverman 1986, Density Estimation, ch. 3)',
        invisible_when='no sample falls into its time; neither a marker within a few '
                       'radii nor pad forces are recorded; in one load case alone it may pass for '
                       'an inclusion',
        leaves_open='pressure under a flat end, and a force that rises and falls or moves')

    def prepare(self, body):
        """Return `body` as it is: the force is a matter of time."""
        return body

    def memory(self, body):
        """Return the share (n,) of the force that each node bears, sum 1; it does not change.

        Raises MeshError if no free surface lies within `radius` of `centre`.
        """
        free = _free_faces(body)
        share = self._integral(body.mesh, free)
        total = share.sum()
        if not total > 0.0:
            middles = body.mesh.nodes[free].mean(axis=1)
            gap = np.linalg.norm(middles - np.array(self.centre), axis=1).min(initial=np.inf)
            raise MeshError(f'external_force: the middle of the nearest free face is '
                            f'{1e3 * gap:.1f} mm from centre, and no part of the free surface '
                            f'within radius = {1e3 * self.radius:g} mm; move it onto the surface')
        return share / total

    def before_step(self, body, memory, t, dt, fields):
        """Add the force to `fields.nodal_force` if it acts at t."""
        if self.onset < t <= self.onset + self.duration:
            fields.nodal_force += np.outer(memory, self.force)

    def after_step(self, body, memory, x, t, dt):
        """Return the shares as they are."""
        return memory

    def _integral(self, mesh, faces):
        """Integral of N_a b over the rest area of faces (f, 3), (n,) [m^2]."""
        corners, centre = mesh.nodes[faces], np.array(self.centre)
        middle = corners.mean(axis=1)
        reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
        near = np.linalg.norm(middle - centre, axis=1) < self.radius + reach
        faces, corners = faces[near], corners[near]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = 0.5 * np.linalg.norm(area, axis=1)
        L = _points(DIVISIONS)
        away = np.linalg.norm(np.einsum('qv,fvi->fqi', L, corners) - centre, axis=2)
        profile = np.maximum(1.0 - (away / self.radius) ** 2, 0.0) ** 2
        nodes, N = _face_shape(mesh, faces, L)
        share = np.zeros(len(mesh.nodes))
        np.add.at(share, nodes, profile @ N * (area / len(L))[:, None])
        return share


def _free_faces(body):
    """Boundary faces (f, 3) neither fixed nor on springs, which quadratic faces have midway."""
    held = np.concatenate([body.fixed, body.springs.nodes])
    outer = boundary_faces(body.mesh)
    base = np.isin(outer, held).all(axis=1)
    if body.mesh.midside is not None:
        base |= np.isin(face_middles(body.mesh, outer), held).all(axis=1)
    return outer[~base]


def _face_shape(mesh, faces, L):
    """Nodes (f, a) of faces (f, 3) and their shape functions (q, a) at L (q, 3)."""
    if mesh.midside is None:
        return faces, L
    middles = 4.0 * L * np.roll(L, -1, axis=1)
    return np.hstack([faces, face_middles(mesh, faces)]), np.hstack([L * (2.0 * L - 1.0), middles])


def _points(n):
    """Barycentric centroids (n^2, 3) of the equal triangles that n divisions of the edges give."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(n), indexing='ij'))
    up, down = i + j < n, i + j < n - 1
    x = np.concatenate([i[up] + 1.0 / 3.0, i[down] + 2.0 / 3.0]) / n
    y = np.concatenate([j[up] + 1.0 / 3.0, j[down] + 2.0 / 3.0]) / n
    return np.column_stack([1.0 - x - y, x, y])
