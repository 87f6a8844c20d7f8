"""What the mesh may have changed in a model's predictions, from an ensemble of companions of it.

Errors of a mesh are close to proportional to how far each pad is pushed, and add up over the pads
(two meshes of one body compared at 2 to 9 mm: patterns alike to 0.9 or better, pairs of pads
additive to 2 to 11 %). So a companion is asked for one thing only, its tangent at rest: how every
observable answers to a push of each pad. Each difference from the model's own tangent, times the
pushes along the recording, is one column.

What the ensemble has in common between channels is kept in part as it is found, and in part
channel by channel: 16 members span far less than the ways in which 19 markers can be off.
Costs a factor of the tangent per member: 8 to 12 s of CPU for 2275 quadratic elements.
Test: diagnosis/forward/test_mesh_errors.py
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.core.quantity import quantity
from arm_brachy.diagnosis.companion import edge_lengths, fitted, ragged, shaken, with_nodes
from arm_brachy.diagnosis.forward import ForwardModel
from arm_brachy.diagnosis.specimen import attach, specimen_of
from arm_brachy.diagnosis.stream import EM, FORCE, OPTICAL
from arm_brachy.diagnosis.trajectory import Equilibria
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.jacobian import Equations, Linearisation, pad_translations
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.refinement import refine

MOST_REFINED = 5000     # elements up to which a mesh is halved for comparison: 3 s, growing fast
AT_REST = 1e-7          # m that nodes may be off: no load acts but the pushes
PLACE = 0.04            # of the median edge: how far off a mesh has what surrounds a point, as
                        # its surface is off by a few hundredths of an edge (envelope of meshers)
SYSTEMATIC = ('rims', 'elements')   # names of columns of what a better mesh would change
LARGEST = 1.4           # standard deviations that the largest of the members counts for


@dataclass(frozen=True)
class EnsembleOptions:
    """Size of the ensemble and how far it is trusted."""

    members: int = 16
    inflation: float = quantity(2.0, '', 'times the deviations within the ensemble', low=0.0,
                                high=100.0, source='least of 1, 1.5, 2, 3 at which three other '
                                'meshes of the breast leave nothing')
    shared: float = quantity(0.5, '', 'share of the variance that is kept as found, common to '
                             'channels', low=0.0, high=1.0, source='own choice')
    growth: float = quantity(0.3, '', 'part of an error that grows with the square of the '
                             'depth, at the deepest push', low=0.0, high=1.0,
                             source='breast meshes: patterns at 2 and at 9 mm differ by 0.1 to '
                                    '0.4 of themselves')


@dataclass(frozen=True)
class MeshErrors:
    """Columns of errors of the mesh, each times its standard deviation.

    names : k;  values : kind -> (n, c, 3, k) SI, channels in the model's order
    systematic : (k,) True for what a better mesh would change, False for what one would that is
        as good
    A mesh at fault is found by taking the systematic columns out of what any model is allowed and
    offering them as a decide.Explanation with cause 'discretisation' instead, the others left in.
    """

    names: tuple
    values: dict
    systematic: np.ndarray

    def part(self, *, systematic):
        """The values kind -> (n, c, 3, m) of the systematic columns, or of the others."""
        return {kind: part[..., self.systematic == systematic]
                for kind, part in self.values.items()}


@dataclass(frozen=True)
class Ensemble:
    """Patterns of what meshes differ in, of one body for all recordings.

    names : k;  patterns : (markers + tools + pads, 3, pads, k) change per push, one standard
    deviation each;  systematic : (k,) as in MeshErrors;  growth : as in EnsembleOptions
    deepest : [m] push at which the part that grows with the square is the share `growth`
    """

    names: tuple
    patterns: np.ndarray
    systematic: np.ndarray
    growth: float
    deepest: float

    def along(self, baseline):
        """Return the MeshErrors of a baseline.Baseline of the same body."""
        push = baseline.path.at(baseline.t)
        k, e = len(baseline.model.specimen.markers), len(baseline.model.specimen.tools)
        ways = [push]
        if self.growth:
            ways.append(self.growth * push * np.abs(push) / self.deepest)
        whole = np.concatenate([np.einsum('np,capj->ncaj', way, self.patterns) for way in ways],
                               axis=3)
        values = {OPTICAL: whole[:, :k], EM: whole[:, k:k + e], FORCE: whole[:, k + e:]}
        return MeshErrors(self.names * len(ways), values, np.tile(self.systematic, len(ways)))


def ensemble_of(model, deepest, rng, options=None):
    """Return the Ensemble of a forward.ForwardModel.

    deepest : [m] of all pushes that it will be asked for
    rng : numpy.random.Generator for the members;  options : EnsembleOptions, None = defaults
    Sensing terms of the model count as ideal here. Raises NotConverged where a member has no
    stable state at rest.
    """
    options = options or EnsembleOptions()
    own = tangent(model.body, model.specimen)
    better = {name: tangent(*one) - own for name, one in _better(model)}
    members = np.stack([tangent(*_member(model, rng)) - own for _ in range(options.members)])
    names, patterns = zip(*[*_systematic(better), *_random(members, better, options)],
                           strict=True)
    return Ensemble(tuple(names), np.stack(patterns, axis=3) * options.inflation,
                    np.array([name in better for name in names]), options.growth, deepest)


def tangent(body, specimen):
    """Return the change (k + e + p, 3, p) of markers, EM targets and pad forces per push [1/m].

    body : SoftBody;  specimen : Specimen of the points, its mesh that of the body before terms.
    What rides on a pad, which no mesh changes, is left out.
    """
    linear = Linearisation(Equations.of(body), body.mesh.nodes, single=True)
    if linear.outstanding() > AT_REST:
        found = Equilibria(body).trajectory(np.zeros(1), np.zeros((1, len(body.pads), 3)))
        if not found.valid[0]:
            raise NotConverged('a companion of the mesh has no state at rest '
                               f'({found.outcomes[0].advice})')
        linear.move_to(found.x[0])
    push = np.stack([pad.direction for pad in body.pads])
    dx = linear.respond(np.einsum('dpi,pi->dp', pad_translations(body).reshape(-1, *push.shape),
                                  push))
    points = attach(specimen, body).matrix(len(body.mesh.nodes))
    moved = np.stack([points @ column.reshape(-1, 3) for column in dx.T], axis=2)
    forces = linear.pad_force_change(dx)
    return np.concatenate([moved, forces])


def _better(model):
    """(name, (SoftBody, Specimen)) of meshes that are better than the model's."""
    specimen, corners = model.specimen, _corners(model.specimen.mesh)
    body = fitted(model.body)
    if body is not None:
        yield 'rims', (body, _moved(model, body))
    linear = specimen.mesh.midside is None
    if linear or len(corners.tets) <= MOST_REFINED:
        finer = corners if linear else refine(corners, np.arange(len(corners.tets)))[0]
        one = specimen_of(specimen.scene, quadratic_mesh(finer))
        yield 'elements', (ForwardModel(one, model.body_terms).body, one)


def _corners(mesh):
    """The TetMesh without the nodes in the middle of edges."""
    n = int(mesh.tets.max()) + 1
    sets = {name: nodes[nodes < n] for name, nodes in mesh.node_sets.items()}
    return TetMesh(mesh.nodes[:n], mesh.tets, sets)


def _member(model, rng):
    """(SoftBody, Specimen) of a mesh that is as good as the model's."""
    body = ragged(model.body, rng)
    body = with_nodes(body, shaken(body, rng))
    specimen = _moved(model, body)
    apart = PLACE * np.median(edge_lengths(model.body.mesh))
    return body, replace(specimen, rest=specimen.rest + apart * rng.normal(
        size=specimen.rest.shape))


def _moved(model, body):
    """The Specimen with its mesh moved as that of `body` is against the model's."""
    mesh = model.specimen.mesh
    shift = body.mesh.nodes - model.body.mesh.nodes
    return replace(model.specimen, mesh=replace(mesh, nodes=mesh.nodes + shift))


# Patterns are (k + e + p, 3, p): per push of each pad, as `tangent` gives them.

def _each_pad(pattern):
    """The pattern split into those of single pads."""
    return [pattern * np.eye(pattern.shape[2])[p] for p in range(pattern.shape[2])]


def _systematic(better):
    for name, pattern in better.items():
        yield from ((name, part) for part in _each_pad(pattern))


def _random(members, better, options):
    """What members (s, k + e + p, 3, p) have in common, then channel by channel, axis by axis.

    The last as large as the difference to a better mesh too: another mesh is as far from it, but
    not by the same pattern.
    """
    share = np.sqrt(options.shared / len(members))
    for member in members:
        yield from (('member', part) for part in _each_pad(share * member))
    # By the largest, all axes together: a marker at a rim is seldom off, and then far.
    off = np.stack([*members, *better.values()])
    sd = np.sqrt((1.0 - options.shared) * np.max(np.mean(off**2, axis=2), axis=0)) / LARGEST
    for c, p in np.argwhere(sd > 0.0):
        for axis in range(3):
            alone = np.zeros(members.shape[1:])
            alone[c, axis, p] = sd[c, p]
            yield 'channel', alone
