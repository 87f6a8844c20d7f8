"""A pad sits elsewhere on the tissue than the scene says, or pushes another way."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.contact_poses import placed, tilted
from arm_brachy.tissue.free_dofs import held_nodes
from arm_brachy.tissue.mesh import embed
from arm_brachy.tissue.sliding import slide_patch
from arm_brachy.tissue.terms.selection import chosen_pads, with_pad


@dataclass(frozen=True)
class PadMisplacement(BodyTerm):
    """Offset along the surface and tilt of the push direction, of one pad or several alike.

    Symbols: c centre and d push direction of the scene; e_u the unit vector across d nearest to
    world z (to x for a pad that pushes along z), e_s = d x e_u; o_u `up`, o_s `side`; a_u
    `tilt_up`, a_s `tilt_side`. The disc keeps its orientation and its set of nodes: these slide
    along the surface with it, and the mesh around them follows (`sliding.slide_patch`), so the
    solution is continuous in the offset where choosing nodes anew would jump. Nothing of the
    tissue moves: markers and targets keep their places in it; markers on the pad go with the pad
    and swing about its centre as its push is tilted (`contact_poses.ridden`).

    Against a scene whose pad is there, 3 mm off, disc of 12 mm, quadratic elements of 3 mm: force
    within 1.1 %, markers within 5 % of what the offset does to them, which is the meshes' own
    error. Holds while the disc stays clear of the base and of other pads and where the surface is
    smooth for a pad's radius around it. A tilted pad is pushed along its new direction but keeps
    the patch that it is bonded to.
    Test: tissue/terms/test_pad_misplacement.py (a scene whose pad is there, continuity, markers)
    """

    up: float = quantity(
        0.0, 'mm', 'offset along the surface, towards world z', low=-50.0, high=50.0,
        prior=('normal', 0.0, 2.0), typical=3.0,
        source='engineering judgement: a pad placed by hand', neutral=0.0)
    side: float = quantity(
        0.0, 'mm', 'offset along the surface, sideways', low=-50.0, high=50.0,
        prior=('normal', 0.0, 2.0), source='as up', neutral=0.0)
    tilt_up: float = quantity(
        0.0, 'deg', 'angle by which the push direction turns towards world z', low=-45.0,
        high=45.0, prior=('normal', 0.0, 2.0),
        source='engineering judgement: a bracket mounted by hand', neutral=0.0)
    tilt_side: float = quantity(
        0.0, 'deg', 'angle by which it turns sideways', low=-45.0, high=45.0,
        prior=('normal', 0.0, 2.0), source='as tilt_up', neutral=0.0)
    pads: tuple[str, ...] = ()  # names; empty means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='pad_misplacement', kind=Kind.BOUNDARY, stage=Stage.BODY,
        summary='a pad sits beside its place, or pushes another way',
        equation='c -> c + o_u e_u + o_s e_s, then along d to the surface;  '
                 'd -> (d + tan(a_u) e_u + tan(a_s) e_s) / |...|',
        source='geometry alone; the sliding mesh: arbitrary Lagrangian-Eulerian description, '
               'Donea et al. 2004, Encyclopedia of Computational Mechanics, vol. 1, ch. 14',
        invisible_when='the pad is not pushed; along a direction in which tissue and supports '
                       'are uniform; a tilt alone, where that pad is pressed by little',
        leaves_open='how the mount bends under load; several pads that are beside their places '
                    'together, as on a bent frame')

    def prepare(self, body):
        """Return `body` with its pads where they are.

        Raises ConfigError for a pad that the body does not have, MeshError if one leaves the
        surface or has no room there.
        """
        for i in chosen_pads(body, self.pads, self.spec.name):
            pad = body.pads[i]
            if self.up or self.side:
                e_u, e_s = placed(pad.centre, pad.direction)[:3, :2].T
                body = self._slid(body, i, self.up * e_u + self.side * e_s)
            if self.tilt_up or self.tilt_side:
                turned = replace(body.pads[i], direction=tilted(
                    pad.direction, self.tilt_up, self.tilt_side))
                body = replace(body, pads=with_pad(body, i, turned))
        return body

    def _slid(self, body, i, offset):
        """`body` with pad i off by `offset` (3,) [m] across its direction."""
        pad, mesh = body.pads[i], body.mesh
        held = np.setdiff1d(held_nodes(body), pad.nodes)
        try:
            nodes, centre = slide_patch(mesh, pad.nodes, pad.centre, pad.direction, offset, held,
                                        _extent(mesh, pad))
        except MeshError as error:
            raise MeshError(f'pad_misplacement: pad {pad.name}: {error}') from None
        slid = replace(mesh, nodes=nodes)
        return replace(body, mesh=slid, scene_nodes=nodes,
                       pads=with_pad(body, i, replace(pad, centre=centre)),
                       nodal_mass=_kept_in_place(body.nodal_mass, mesh, slid),
                       nodal_force=_kept_in_place(body.nodal_force, mesh, slid))


def _kept_in_place(loads, mesh, slid):
    """Loads (n, ...) of the nodes of `mesh` handed to the nodes around their places in `slid`."""
    if loads is None:
        return None
    loaded = loads.reshape(len(loads), -1).any(axis=1)
    moved = np.flatnonzero(loaded & (mesh.nodes != slid.nodes).any(axis=1))
    riders = embed(slid, mesh.nodes[moved], onto_surface=True)
    kept = loads.copy()
    kept[moved] = 0.0
    return kept + riders.matrix(len(loads)).T @ loads[moved]


def _extent(mesh, pad):
    """Radius [m] of the disc that its nodes span."""
    across = mesh.nodes[pad.nodes] - pad.centre
    across -= np.outer(across @ pad.direction, pad.direction)
    return float(np.linalg.norm(across, axis=1).max())
