"""How the data set loads and disturbs a scene's body: contacts, and everything that moves it.

In a displacement-driven body a homogeneous modulus moves nothing, so that the thesis' 10 to 60 kPa
matter here only against a weight and a base that gives. What else the model may have wrong is
drawn besides: lump, gradient, compressibility, fibres, pads a little off.
Test: estimation/graph_vae/test_dataset.py
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import InputError, MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.random import stream
from arm_brachy.core.scene import PadPatch
from arm_brachy.tissue.build import build_body, load_scene_mesh
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.terms.anisotropy import Anisotropy
from arm_brachy.tissue.terms.base_compliance import BaseCompliance
from arm_brachy.tissue.terms.compressibility import Compressibility
from arm_brachy.tissue.terms.gravity import Gravity
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.stiffness_gradient import StiffnessGradient

DRAWS = 50              # of contacts, until they have room; far more than a body should need


@dataclass(frozen=True)
class LoadOptions:
    """From what a walk is drawn. Thesis sec. 5.4 where it says; judgement where it does not."""

    steps: int = 12             # states of a walk, equally far apart
    own_pads: float = 0.6       # share of walks with the scene's pads, all four bonded
    two_contacts: float = 0.5
    with_term: float = 0.5      # chance of each term; a walk without any is the model itself
    shallow: float = quantity(5.0, 'mm', 'least depth at the end of a walk', low=0.1,
                              source='thesis sec. 5.4')
    deep: float = quantity(30.0, 'mm', 'greatest depth at the end of a walk', low=0.1,
                           source='thesis sec. 5.4')
    soft: float = quantity(6.0, 'kPa', "least Young's modulus", low=0.1,
                           source="the scene's own; the thesis has 10")
    hard: float = quantity(60.0, 'kPa', "greatest Young's modulus", low=0.1,
                           source='thesis sec. 5.4')
    small_pad: float = quantity(10.0, 'mm', 'least radius of a random contact', low=1.0,
                                source='half a pad of the scene')
    large_pad: float = quantity(20.0, 'mm', 'greatest radius of a random contact', low=1.0,
                                source='a pad of the scene')
    offset: float = quantity(2.0, 'mm', "standard deviation of a pad's place along the surface",
                             low=0.0, source='as the prior of term pad_misplacement')
    tilt: float = quantity(2.0, 'deg', "standard deviation of a pad's push direction", low=0.0,
                           source='as the prior of term pad_misplacement')
    lean: float = quantity(10.0, 'deg', "standard deviation of a random contact's direction from "
                           'the normal', low=0.0, source='a finger or probe, judgement')


@dataclass(frozen=True)
class Walk:
    """One way into the tissue.

    body : SoftBody, terms and pads in it;  travel : (p,) [m] of each pad at the end, 0 = idle
    kind : 'own' or 'random';  drawn : what was drawn, for the manifest
    """

    body: object
    travel: np.ndarray
    kind: str
    drawn: dict


def draw_walk(scene, seed, number, options=None):
    """Return Walk `number` of the data set of a Scene under `seed`; the same for the same three.

    Raises InputError if contacts find no room on the body.
    """
    options = LoadOptions() if options is None else options
    rng = stream(seed, f'walk/{number}')
    mesh = load_scene_mesh(scene)
    own = bool(scene.pads) and rng.random() < options.own_pads
    E = float(np.exp(rng.uniform(np.log(options.soft), np.log(options.hard))))
    scene = replace(scene, material=replace(scene.material, E=E), loads=())
    count = 1 + int(rng.random() < options.two_contacts)
    depths = rng.uniform(options.shallow, options.deep, count)
    for _ in range(DRAWS):
        pads, pushed = (_own_pads if own else _random_pads)(scene, mesh, count, options, rng)
        try:
            body = build_body(replace(scene, pads=pads), mesh)
        except MeshError:
            continue
        break
    else:
        raise InputError(f'scene {scene.name}: {count} contacts of {1e3 * options.large_pad:g} mm '
                         f'found no room in {DRAWS} draws; make large_pad smaller')
    terms = draw_terms(body, options, rng)
    for term in terms:
        body = term.prepare(body)
    travel = np.zeros(len(pads))
    travel[pushed] = depths
    drawn = {'number': number, 'kind': 'own' if own else 'random', 'E_kPa': round(1e-3 * E, 3),
             'depth_mm': [round(1e3 * float(d), 3) for d in depths],
             'terms': [term.spec.name for term in terms]}
    return Walk(body, travel, drawn['kind'], drawn)


def draw_terms(body, options, rng):
    """Return the BodyTerm instances of one walk, in the order of the registry.

    body : SoftBody, whose size says where a lump may lie
    """
    def present():
        return rng.random() < options.with_term

    low, high = body.mesh.nodes.min(axis=0), body.mesh.nodes.max(axis=0)
    terms = []
    if present():
        terms.append(Compressibility(factor=_between(rng, 0.2, 1.5)))
    if present():
        terms.append(StiffnessGradient(gradient=tuple(rng.normal(0.0, 5.6, 3))))
    if present():
        centre = low + (high - low) * rng.uniform(0.15, 0.85, 3)
        terms.append(Inclusion(centre=tuple(centre), radius=rng.uniform(5e-3, 12e-3),
                               ratio=_between(rng, 0.3, 10.0)))
    if present():
        terms.append(Anisotropy(ratio=rng.uniform(0.0, 0.5), azimuth=rng.uniform(-np.pi, np.pi),
                                elevation=np.arcsin(rng.uniform(-1.0, 1.0))))
    if present():
        lean, around = rng.normal(0.0, np.deg2rad(10.0)), rng.uniform(-np.pi, np.pi)
        down = np.array([np.sin(lean) * np.cos(around), np.sin(lean) * np.sin(around),
                         -np.cos(lean)])
        terms.append(Gravity(added=tuple(9.81 * rng.choice([-1.0, 1.0]) * down)))
    if present():
        normal = 1e6 * _between(rng, 0.3, 10.0)
        terms.append(BaseCompliance(normal=normal, tangential=normal * _between(rng, 0.3, 1.0)))
    return tuple(terms)


def _between(rng, low, high):
    """A number (float) whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _own_pads(scene, mesh, count, options, rng):
    """The scene's pads, those pushed a little off: (pads, indices of those pushed)."""
    pushed = rng.permutation(len(scene.pads))[:count]
    pads = list(scene.pads)
    for i in pushed:
        pad = pads[i]
        across = _across(pad.direction)
        centre = np.array(pad.centre) + across @ rng.normal(0.0, options.offset, 2)
        direction = np.array(pad.direction) + across @ np.tan(rng.normal(0.0, options.tilt, 2))
        pads[i] = replace(pad, centre=tuple(centre), direction=tuple(_unit(direction)),
                          contact='bonded')
    return tuple(pads), pushed


def _random_pads(scene, mesh, count, options, rng):
    """Discs anywhere on the surface, pushed along its normal, more or less."""
    corners = mesh.nodes[boundary_faces(mesh)]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(area, axis=1)
    pads = []
    for i in rng.choice(len(size), count, p=size / size.sum()):
        inward = -area[i] / size[i]
        lean = _across(inward) @ np.tan(rng.normal(0.0, options.lean, 2))
        pads.append(PadPatch(name=f'contact_{len(pads) + 1}',
                             centre=tuple(corners[i].mean(axis=0)),
                             direction=tuple(_unit(inward + lean)),
                             radius=rng.uniform(options.small_pad, options.large_pad)))
    return tuple(pads), np.arange(count)


def _across(direction):
    """(3, 2) orthonormal vectors across a direction."""
    return np.linalg.svd(np.atleast_2d(np.array(direction, dtype=float)))[2][1:].T


def _unit(vector):
    return vector / np.linalg.norm(vector)
