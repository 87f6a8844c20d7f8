"""What the mesh may have changed in a model's predictions, from an ensemble of companions of it.

Errors of a mesh add up over the pads (two meshes of one body, pushes to 9 mm: to 2 to 11 %) and
have two parts, of different patterns: one in proportion to how far a pad is pushed, and one that
grows with the square, as tissue about a rim gives way (two meshes of a dome: as large as the first
at 6 mm, and like a stiffer skin). So a companion is asked for two things per pad, its tangent at
rest and its curvature. Each difference from the model's own, times the pushes or half their
squares along the recording, is one column.

What the ensemble has in common between channels is kept in part as it is found, and in part
channel by channel: 16 members span far less than the ways in which 19 markers can be off.
What finer elements change is a series in their size: from halving them the rest follows, by a
factor 1 / (1 - 2^-p) that a body has in common for all its pads, p from 1 (the rim of a bonded
disc) to 2. Nineteen pads of four bodies, forces against other codes' fine meshes: 1.5 to 2 times
what halving changes, from pad to pad 0.1 to 0.35. That is one column for all pads; beside it
every pad has its own, since a large effect changes what a mesh does to it.
Where recordings bear out that they are of what finer elements come to (`mesh_convergence`), the
rest of the series is added to the model, and far less is left that it may be wrong by (`Limit`). A
recording that another code made on a mesh of its own, as coarse as ours, does not.
Other codes' quadratic elements carry volume change at all points and lock a little, where ours
carry it at one and are a little soft: what that changes is one column, on the model's own mesh.
A sound recording of such elements was 19 nats likelier with it; without it the same 15 nats spoke
for a bulk modulus 2.4 times as large.
Costs a factor of the tangent per member: 6 s of CPU for 2275 quadratic elements.
Test: diagnosis/forward/test_mesh_errors.py
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.diagnosis.likelihood.mesh_ensemble import (
    edge_lengths,
    fitted,
    ragged,
    shaken,
    with_nodes,
)
from arm_brachy.diagnosis.likelihood.mesh_tangents import pushes
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.progress import MESHES, Count, untold
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.refinement import refine

MOST_REFINED = 5000     # elements up to which a mesh is halved for comparison: 3 s, growing fast
PLACE = 0.04            # of the median edge: how far off a mesh has what surrounds a point, as
                        # its surface is off by a few hundredths of an edge (envelope of meshers)
RIMS, ELEMENTS = 'rims', 'elements'
SYSTEMATIC = (RIMS, ELEMENTS)       # names of columns of what a better mesh would change,
# and of what one would that is as good, or whose elements carry volume change at all points
MEMBER, CHANNEL, IN_FULL = 'member', 'channel', 'in_full'
NAMES = (*SYSTEMATIC, MEMBER, CHANNEL, IN_FULL)
LARGEST = 1.4           # standard deviations that the largest of the members counts for


@dataclass(frozen=True)
class EnsembleOptions:
    """Size of the ensemble and how far it is trusted."""

    members: int = 16
    finer: bool = True      # also by elements half as wide, where the mesh is small enough
    inflation: float = quantity(2.0, '', 'times the deviations within the ensemble', low=0.0,
                                high=100.0, source='least of 1, 1.5, 2, 3 at which three other '
                                'meshes of the breast leave nothing, by tangents')
    apart: float = quantity(1.0, '', 'of what halving the elements changes, deviation from pad '
                            'to pad', low=0.0, high=10.0, source='own choice: 0.1 to 0.35 by the '
                            'pads of 4 bodies; beside 0.25 a law that doubles the modulus at '
                            'depth, as planted, is not found to explain its recording')
    shared: float = quantity(0.5, '', 'share of the variance that is kept as found, common to '
                             'channels', low=0.0, high=1.0, source='own choice')
    in_full: float = quantity(1.0, '', 'of what it changes that quadratic elements carry volume '
                              'change at all points, standard deviation for all pads together',
                              low=0.0, high=10.0, source="other codes' plain elements do: one "
                              'deviation on a mesh as coarse as ours, less on a finer one')
    limit: float = quantity(1.75, '', 'times what halving the elements changes, what elements of '
                            'no size do', low=0.0, high=10.0, source='1.5 to 2 by the forces of '
                            '19 pads on 4 bodies')
    limit_sd: float = quantity(0.35, '', 'standard deviation of that, for all pads together and '
                               'for each', low=0.0, high=10.0, source='own choice: the same '
                               '19 pads, 0.1 to 0.35 from pad to pad')
    limit_in_full: float = quantity(0.5, '', 'the same, where the limit holds', low=0.0, high=10.0,
                                    source='own choice: of elements half as wide, or less')
    limit_forces: float = quantity(1.0, '', 'times the deviations of forces within the ensemble, '
                                   'where the limit holds', low=0.0, high=100.0,
                                   source='own choice: 13 recordings of another code on finer '
                                   'elements are 10 to 30 nats likelier by the limit so; '
                                   'positions at single points may be off by more')


@dataclass(frozen=True)
class MeshErrors:
    """Columns of errors of the mesh, each times its standard deviation.

    names : k;  values : kind -> (n, c, 3, k) SI, channels in the model's order
    systematic : (k,) True for what a better mesh would change, False for what one would that is
        as good
    A mesh at fault is found by taking the systematic columns out of what any model is allowed and
    offering them as a judge.Explanation with cause 'discretisation' instead, the others left in.
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

    names : k;  systematic : (k,) as in MeshErrors
    tangents, curvatures : (markers + tools + pads, 3, pads, k) first and second derivative by the
    push of each pad, SI, one standard deviation each
    limit : Limit of finer elements, None where they are not known
    """

    names: tuple
    systematic: np.ndarray
    tangents: np.ndarray
    curvatures: np.ndarray
    limit: 'Limit | None' = None

    def along(self, baseline):
        """Return the MeshErrors of a linearised.Baseline of the same body."""
        push = baseline.path.at(baseline.t)
        whole = np.concatenate([
            np.einsum('np,capj->ncaj', push, self.tangents),
            np.einsum('np,capj->ncaj', 0.5 * push**2, self.curvatures)], axis=3)
        return MeshErrors(self.names * 2, _by_kind(whole, baseline.model.specimen),
                          np.tile(self.systematic, 2))


@dataclass(frozen=True)
class Limit:
    """What elements of no size add to the model, extrapolated from halving them (Richardson).

    tangents, curvatures : (markers + tools + pads, 3, pads) as in Ensemble
    left : Ensemble of what that may be wrong by
    Good for small departures from the model: a cause that changes all changes this with it.
    """

    tangents: np.ndarray
    curvatures: np.ndarray
    left: Ensemble

    def along(self, baseline):
        """Return kind -> (n, c, 3) SI, to be added to a linearised.Baseline of the same body."""
        push = baseline.path.at(baseline.t)
        whole = (np.einsum('np,cap->nca', push, self.tangents)
                 + np.einsum('np,cap->nca', 0.5 * push**2, self.curvatures))
        return _by_kind(whole, baseline.model.specimen)


def _by_kind(values, specimen):
    """Values (n, markers + tools + pads, ...) of all channels by the kind of their stream."""
    k, e = len(specimen.markers), len(specimen.tools)
    return {OPTICAL: values[:, :k], EM: values[:, k:k + e], FORCE: values[:, k + e:]}


def ensemble_of(model, rng, options=None, progress=untold):
    """Return the Ensemble of a forward.ForwardModel.

    rng : numpy.random.Generator for the members;  options : EnsembleOptions, None = defaults
    progress : as in `progress`, of the step MESHES
    Sensing terms of the model count as ideal here. Raises NotConverged where a member has no
    stable state.
    """
    options = options or EnsembleOptions()
    meshes = Count(progress, MESHES, options.members + len(SYSTEMATIC) + 2)

    def counted(companion):
        meshes.begin()
        found = pushes(*companion)
        meshes.finish()
        return found

    own = counted((model.body, model.specimen))

    def off(companion):
        return [there - here for there, here in zip(counted(companion), own, strict=True)]

    better = {name: off(one) for name, one in _better(model, options.finer)}
    meshes.expect(len(better) - len(SYSTEMATIC))
    members = [off(_member(model, rng)) for _ in range(options.members)]
    plain = off((replace(model.body, in_full=True), model.specimen))
    moves, size = np.any(own[0] != 0.0, axis=1), options.inflation
    found = _ensemble(better, members, plain, moves, options, _Sizes(
        size, options.apart * size, size, size * np.ones(len(moves)), options.in_full))
    if ELEMENTS not in better or model.specimen.mesh.midside is None:
        return found    # from linear elements to quadratic ones is no step of a series
    forces = np.arange(len(moves)) >= len(moves) - len(model.specimen.pads)
    left = _ensemble(better, members, plain, moves, options, _Sizes(
        options.limit_sd, options.limit_sd, size, np.where(forces, options.limit_forces, size),
        options.limit_in_full))
    tangents, curvatures = (options.limit * pattern for pattern in better[ELEMENTS])
    return replace(found, limit=Limit(tangents, curvatures, left))


def _better(model, finer):
    """(name, (SoftBody, Specimen)) of meshes that are better than the model's.

    finer : False leaves out the one with smaller elements, or quadratic ones
    """
    specimen, corners = model.specimen, _corners(model.specimen.mesh)
    body = fitted(model.body)
    if body is not None:
        yield RIMS, (body, _moved(model, body))
    linear = specimen.mesh.midside is None
    if finer and (linear or len(corners.tets) <= MOST_REFINED):
        small = corners if linear else refine(corners, np.arange(len(corners.tets)))[0]
        one = specimen_of(specimen.scene, quadratic_mesh(small))
        yield ELEMENTS, (ForwardModel(one, model.body_terms).body, one)


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


# Patterns are (k + e + p, 3, p), one push of every pad, as `moves` gives them.

@dataclass(frozen=True)
class _Sizes:
    """Standard deviations: of what halving changes, for all pads together and for each; of what
    fitted rims change; (k + e + p,) of what members deviate by; of what plain elements change.
    """

    together: float
    apart: float
    rims: float
    members: np.ndarray
    in_full: float


def _ensemble(better, members, plain, moves, options, sizes):
    """The Ensemble of better meshes, name -> (tangent, curvature), of members, and of elements
    that carry volume change at all points, a pair each.
    """
    found = [_columns({name: pair[order] for name, pair in better.items()},
                      np.stack([pair[order] for pair in members]), sizes.in_full * plain[order],
                      moves, options.shared, sizes) for order in (0, 1)]
    (names, tangents), (_, curvatures) = found
    return Ensemble(names, np.array([name in better for name in names]), tangents, curvatures)


def _columns(better, members, plain, moves, shared, sizes):
    """(names k, patterns (k + e + p, 3, p, k)) of better meshes, members and single channels.

    better : name -> pattern;  members : (s, k + e + p, 3, p);  shared : of EnsembleOptions
    plain : (k + e + p, 3, p) of elements that carry volume change at all points
    moves : (k + e + p, p) channels that answer to a push at all;  sizes : _Sizes
    """
    apart = {name: (sizes.apart if name == ELEMENTS else sizes.rims) * pattern
             for name, pattern in better.items()}
    members = sizes.members[:, None, None] * members
    together = [(ELEMENTS, sizes.together * better[ELEMENTS])] if ELEMENTS in better else []
    together += [(IN_FULL, plain)] if plain.any() else []   # linear elements have but one point
    columns = [*together, *_by_pad(apart), *_shared(members, shared),
               *_channels(np.stack([*members, *apart.values()]), moves, shared)]
    names, patterns = zip(*columns, strict=True)
    return names, np.stack(patterns, axis=3)


def _each_pad(pattern):
    """The pattern split into those of single pads."""
    return [pattern * np.eye(pattern.shape[2])[p] for p in range(pattern.shape[2])]


def _by_pad(better):
    for name, pattern in better.items():
        yield from ((name, part) for part in _each_pad(pattern))


def _shared(members, shared):
    """What members have in common between channels."""
    share = np.sqrt(shared / len(members))
    for member in members:
        yield from ((MEMBER, part) for part in _each_pad(share * member))


def _channels(off, moves, shared):
    """The rest, channel by channel, axis by axis.

    off : (s, k + e + p, 3, p) of members, of better meshes what pads have apart: another mesh is
        as far off as those are, but not by the same pattern
    """
    # By the largest, all axes together: a marker at a rim is seldom off, and then far.
    sd = np.sqrt((1.0 - shared) * np.max(np.mean(off**2, axis=2), axis=0)) / LARGEST
    for c, p in np.argwhere(moves):
        for axis in range(3):
            alone = np.zeros(off.shape[1:])
            alone[c, axis, p] = sd[c, p]
            yield CHANNEL, alone
