"""A scene's body with what is attached to it, built once for all hypotheses about it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_brachy.cell import pad_directions
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.place import Place
from arm_brachy.core.scene import Scene, check_scene
from arm_brachy.diagnosis.signals.stream import BASE, TISSUE
from arm_brachy.tissue.body import SoftBody, TetMesh
from arm_brachy.tissue.build import build_body, placement_mesh
from arm_brachy.tissue.contact_poses import ridden
from arm_brachy.tissue.mesh import Embedding, embed, interpolate


@dataclass(frozen=True)
class Specimen:
    """What a scene describes, ready to be solved for.

    scene : core.scene.Scene;  mesh : TetMesh;  body : SoftBody without terms
    directions : (p, 3) unit push directions of the scene
    markers : k names of optical markers, carriers : what each sits on (TISSUE, BASE or a pad)
    tools : e names of EM targets, all in the tissue
    rest : (k + e, 3) [m] places of both in the scene
    """

    scene: Scene
    mesh: TetMesh
    body: SoftBody
    directions: np.ndarray
    markers: tuple
    carriers: tuple
    tools: tuple
    rest: np.ndarray

    @property
    def pads(self):
        """Names of the pads."""
        return self.body.pad_names


def specimen_of(scene, mesh=None):
    """Return the Specimen of a core.scene.Scene with pads; what follows has no inertia.

    mesh : TetMesh to use instead of the scene's file
    Raises ConfigError for a scene without pads, for which there is no forward model here, and for
    one that names what it does not have.
    """
    if not scene.pads:
        raise ConfigError(f'scene {scene.name} has no pads; must have one at least: without '
                          'pads the path of the body is no function of the encoders')
    check_scene(scene, Place(Path(f'scene {scene.name}')))
    body = build_body(scene, mesh)
    carriers = tuple(m.body for m in scene.markers)
    rest = np.array([p.position for p in (*scene.markers, *scene.targets)]).reshape(-1, 3)
    return Specimen(scene, body.mesh, body, pad_directions(scene),
                    tuple(m.name for m in scene.markers), carriers,
                    tuple(t.name for t in scene.targets), rest)


@dataclass(frozen=True)
class Attachment:
    """How markers and EM targets follow a body that terms have prepared.

    rest : (k + e, 3) [m] at rest, those on a displaced pad with it
    inside : (k + e,) True for points in the tissue;  embedding : Embedding of these
    on_pad : (k + e, p) 1 where a point rides on a pad;  on_base : (k + e,)
    """

    rest: np.ndarray
    inside: np.ndarray
    embedding: Embedding
    on_pad: np.ndarray
    on_base: np.ndarray

    def points(self, x, pads, base):
        """Return positions (k + e, 3) [m] with the nodes at x (n, 3).

        pads : (p, 3) [m] displacements;  base : (3,) [m] that of the base
        """
        out = self.rest + self.on_pad @ pads + np.outer(self.on_base, base)
        out[self.inside] = interpolate(self.embedding, x)
        return out

    def matrix(self, n):
        """Return the sparse ((k + e), n) matrix from nodes to points, zero rows outside."""
        rows = np.flatnonzero(self.inside)
        inside = self.embedding.matrix(n).tocoo()
        return type(inside)((inside.data, (rows[inside.row], inside.col)),
                            shape=(len(self.rest), n)).tocsr()


def attach(specimen, body):
    """Return the Attachment of a Specimen's points to `body`, its body as terms prepared it."""
    carriers = np.array([*specimen.carriers, *[TISSUE] * len(specimen.tools)])
    on_pad = (carriers[:, None] == np.array(specimen.pads)).astype(float)
    rest, inside = specimen.rest.copy(), carriers == TISSUE
    for riders, old, new in zip(on_pad.T > 0.0, specimen.body.pads, body.pads, strict=True):
        rest[riders] = ridden(rest[riders], (old.centre, old.direction),
                              (new.centre, new.direction))
    names = [*specimen.markers, *specimen.tools]
    embedding = embed(placement_mesh(specimen.mesh, body), rest[inside],
                      names=[name for name, here in zip(names, inside, strict=True) if here])
    return Attachment(rest, inside, embedding, on_pad, (carriers == BASE).astype(float))
