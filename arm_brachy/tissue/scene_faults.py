"""What in a scene cannot be meant: points off the body, values that look like another unit.

Each rule looks at a consequence (a marker that nothing carries, a push that no actuator makes, a
body that flows under its weight), so that it holds for bodies of any size. A factor of a thousand
between two numbers that should agree is said to be a unit.
Test: tissue/test_scene_faults.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.scene import TISSUE
from arm_brachy.tissue.mesh import STANDOFF, boundary_faces, surface_distance

MM, KPA = 1e3, 1e-3
SLIP = 1e3          # between m and mm, kPa and Pa, kg and g
OWN = 'own choice: wide of every phantom and tissue in the sources of `Material`'


@dataclass(frozen=True)
class Plausible:
    """Beyond these a value is not meant; none of them is a property of a good scene."""

    smallest: float = quantity(3.0, 'mm', 'largest extent of a body, at least', source=OWN)
    largest: float = quantity(2000.0, 'mm', 'largest extent of a body, at most', source=OWN)
    apart: float = quantity(20.0, '', 'sizes of body and of all that is placed on it, ratio',
                            source=OWN)
    deep: float = quantity(3.0, 'mm', 'marker inside the body: glue and facets of a mesh leave '
                           'less', source=OWN)
    held: float = quantity(0.5, 'mm', 'from a face that is held: nothing that moves is seen there',
                           source=OWN)
    sensor: float = quantity(0.25, 'mm', 'target under the surface, at least', source='half the '
                             'diameter of the thinnest EM sensor (NDI Aurora, 0.5 mm)')
    softest: float = quantity(0.1, 'kPa', "Young's modulus, at least", source=OWN)
    stiffest: float = quantity(2e4, 'kPa', "Young's modulus, at most", source=OWN)
    weakest: float = quantity(0.01, 'N', 'force of a full push: what a load cell resolves',
                              source='ATI Nano17 SI-12-0.12 resolves 3 mN')
    strongest: float = quantity(500.0, 'N', 'force of a full push', source='ten times the 50 N at '
                                'which the bank of the cell stops')
    lightest: float = quantity(200.0, 'kg_m3', 'density, at least', source='foams')
    heaviest: float = quantity(5000.0, 'kg_m3', 'density, at most', source='filled elastomers')
    falls: float = quantity(20.0, 'm_s2', 'gravity, at most: twice that of the Earth', source=OWN)
    sags: float = quantity(2.0, '', 'weight over modulus, rho g height / E, at most', source=OWN)
    stroke: float = quantity(0.1, 'mm', 'stroke, at least', source=OWN)
    load: float = quantity(20.0, '', 'hung mass over that of the body, at most', source=OWN)
    feather: float = quantity(1e-4, '', 'hung mass over that of the body, at least', source=OWN)


@dataclass(frozen=True)
class Fault:
    """One thing that is not meant, in words of a message.

    name : of the point, pad or load, '' for the body;  what : whose, value;  allowed, do : rest
    """

    name: str
    what: str
    allowed: str
    do: str = ''

    @property
    def kind(self):
        """'marker', 'target', 'pads', ...: the first word of what is wrong."""
        return self.what.split()[0].rstrip(':')

    def __str__(self):
        return '; '.join(part for part in (self.what, self.allowed, self.do) if part)


def size_faults(scene, mesh, limits=Plausible()):
    """Faults of the size of a mesh (TetMesh) beside a core.scene.Scene; () is none.

    To be looked at before a body is built: on a mesh of another unit there is nothing to hold.
    """
    size, unit = np.ptp(mesh.nodes, axis=0).max(), scene.mesh.unit
    other = {'m': 'mm', 'mm': 'm'}[unit]
    said = f'mesh: {size * MM:.3g} mm long with unit: {unit}'
    ask = f'is the file in {other}? Write mesh: {{..., unit: {other}}}'
    if not limits.smallest <= size <= limits.largest:
        return (Fault('', said, f'must be {limits.smallest * MM:g} to {limits.largest * MM:g} mm',
                      ask),)
    spread = _spread(scene)
    if spread and not 1.0 / limits.apart <= spread / size <= limits.apart:
        return (Fault('', said, 'but pads, markers, targets and loads are within '
                      f'{spread * MM:.3g} mm of its origin',
                      f'{ask}, or positions that end on _mm are in m'),)
    return ()


def _spread(scene):
    """Largest coordinate [m] of what is placed, 0.0 if nothing is."""
    points = [p.centre for p in scene.pads] + [p.position for p in (
        *scene.markers, *scene.targets, *scene.loads)]
    return float(np.abs(np.array(points)).max(initial=0.0))


def scene_faults(scene, body, limits=Plausible()):
    """All other faults of a core.scene.Scene and its SoftBody; () is none."""
    return (*_point_faults(scene, body, limits), *_material_faults(scene, body, limits),
            *_pad_faults(scene, body, limits), *_load_faults(scene, body, limits))


def stroke_faults(scene, travels):
    """Faults of strokes beside a recording; travels : pad name -> largest travel [m]."""
    return tuple(
        Fault(pad.name, f'pads {pad.name}: stroke_mm = {pad.stroke * MM:g}',
              f'must be at least the {travels[pad.name] * MM:.3g} mm that were recorded')
        for pad in scene.pads if travels.get(pad.name, 0.0) > pad.stroke + LEEWAY)


LEEWAY = 0.2e-3     # m, by which an encoder's noise and its zero may exceed a stroke


def _point_faults(scene, body, limits):
    """Markers on the tissue off its surface or on what is held, targets outside."""
    glued = [m for m in scene.markers if m.body == TISSUE]
    points = np.array([p.position for p in (*glued, *scene.targets)]).reshape(-1, 3)
    if not len(points):
        return ()
    away, still = surface_distance(body.mesh, points), _to_held(body, points)
    out = []
    for k, one in enumerate((*glued, *scene.targets)):
        fault = (_marker_fault if k < len(glued) else _target_fault)(
            one.name, away[k], still[k], limits)
        if fault:
            hint = _hint(body, np.array(one.position), k < len(glued), limits)
            out.append(Fault(one.name, *fault, hint))
    return (*out, *_slipped(scene, body))


def _marker_fault(name, away, still, limits):
    if away > STANDOFF:
        return (f'marker {name}: {away * MM:.3g} mm off the surface',
                f'must be at most {STANDOFF * MM:g} mm, or be on the base or a pad (body:)')
    if away < -limits.deep:
        return (f'marker {name}: {-away * MM:.3g} mm inside the body',
                f'must be at most {limits.deep * MM:g} mm')
    if still < limits.held:
        return (f'marker {name}: on the face that is held, which does not move',
                'must be elsewhere, or have body: base')
    return None


def _target_fault(name, away, still, limits):
    if away > -limits.sensor:
        where = f'{away * MM:.3g} mm outside' if away > 0.0 else f'{-away * MM:.2g} mm under'
        return (f'target {name}: {where} the surface',
                f'must be {limits.sensor * MM:g} mm or more inside')
    return None


def _to_held(body, points):
    """Distance (k,) [m] of points to the nearest face all of whose nodes are held."""
    faces = boundary_faces(body.mesh)
    held = faces[np.isin(faces, body.fixed).all(axis=1)]
    if not len(held):
        return np.full(len(points), np.inf)
    corners = body.mesh.nodes[held]
    return np.array([_nearest(corners, point) for point in points])


def _nearest(corners, point):
    """Distance [m] of a point (3,) to the planes of triangles (f, 3, 3) over which it stands."""
    a = corners[:, 0]
    u, v, w = corners[:, 1] - a, corners[:, 2] - a, point - a
    n = np.cross(u, v)
    square = np.einsum('fi,fi->f', n, n)
    s = np.einsum('fi,fi->f', np.cross(w, v), n) / square
    t = np.einsum('fi,fi->f', np.cross(u, w), n) / square
    over = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0)
    height = np.abs(np.einsum('fi,fi->f', w, n)) / np.sqrt(square)
    return height[over].min(initial=np.inf)


def _hint(body, point, marker, limits):
    """What to do with a point that is off: whether metres for some coordinates would mend it."""
    small = (np.abs(point) < 1e-3) & (point != 0.0)
    for axes in ([k] for k in np.flatnonzero(small)):
        if _fits(body, point, axes, marker, limits):
            return (f'{"xyz"[axes[0]]} = {point[axes[0]] * MM:.3g} mm looks like metres: '
                    f'{point[axes[0]] * MM * SLIP:.3g} mm?')
    if small.any() and _fits(body, point, np.flatnonzero(small), marker, limits):
        return f'{_mm(point)} mm looks like metres: {_mm(point * SLIP)} mm?'
    far = np.abs(point).max() > 10.0 * np.ptp(body.mesh.nodes, axis=0).max()
    if far and _fits(body, point / SLIP, (), marker, limits):
        return f'{_mm(point)} mm looks like micrometres'
    return 'compare it with the rig, in the frame of the mesh'


def _mm(point):
    return '[' + ', '.join(f'{v * MM:.3g}' for v in point) + ']'


def _fits(body, point, axes, marker, limits):
    """True if a point (3,), times SLIP along `axes`, lies where a marker or target may be."""
    moved = np.array(point, dtype=float)
    moved[list(axes)] *= SLIP
    away = surface_distance(body.mesh, [moved])[0]
    return -limits.deep <= away <= STANDOFF if marker else away < -limits.sensor


def _slipped(scene, body):
    """Markers on base and pads all of whose coordinates are a thousandth of the body or so."""
    size = np.ptp(body.mesh.nodes, axis=0).max()
    return tuple(
        Fault(m.name, f'marker {m.name}: {_mm(np.array(m.position))} mm, on {m.body}',
              f'is at the origin of a body of {size * MM:.3g} mm', 'are the values metres?')
        for m in scene.markers if m.body != TISSUE
        and 0.0 < np.abs(m.position).max() < size / SLIP * 2.0)


def _material_faults(scene, body, limits):
    material, g = scene.material, float(np.linalg.norm(scene.gravity))
    if not limits.softest <= material.E <= limits.stiffest:
        yield Fault('', f'material: E_kPa = {material.E * KPA:g}',
                    f'must be {limits.softest * KPA:g} to {limits.stiffest * KPA:g}',
                    _modulus_hint(material.E, limits))
    if not limits.lightest <= material.density <= limits.heaviest:
        yield Fault('', f'material: density_kg_m3 = {material.density:g}',
                    f'must be {limits.lightest:g} to {limits.heaviest:g}',
                    'is it in g/cm3? Water has 1000 kg/m3')
    if g > limits.falls:
        yield Fault('', f'gravity_m_s2: {g:g} in size', f'must be at most {limits.falls:g}',
                    'the Earth has 9.81')
        return
    height = np.ptp(body.mesh.nodes @ np.array(scene.gravity)) / g if g else 0.0
    if material.density * g * height > limits.sags * material.E:
        yield Fault('', f'material: E_kPa = {material.E * KPA:g} under its own weight, '
                    f'{material.density * g * height * KPA:.3g} kPa at the foot',
                    f'it would flow: must be at least '
                    f'{material.density * g * height / limits.sags * KPA:.3g} kPa',
                    'check E_kPa, density_kg_m3 and gravity_m_s2')


def _modulus_hint(E, limits):
    wrong, right = ('Pa', E / SLIP) if E > limits.stiffest else ('MPa', E * SLIP)
    return f'is it in {wrong}? Then it is {right * KPA:g}'


def _pad_faults(scene, body, limits):
    """Strokes beside the body, and pushes of all that have a possible one."""
    pushed = []
    for patch, pad in zip(scene.pads, body.pads, strict=True):
        name = f'pads {pad.name}'
        if not 0.0 < patch.stroke:
            continue
        depth = np.ptp(body.mesh.nodes @ pad.direction)
        if patch.stroke < limits.stroke:
            yield Fault(pad.name, f'{name}: stroke_mm = {patch.stroke * MM:g}', 'must be at least '
                        f'{limits.stroke * MM:g}', f'is it {patch.stroke * MM * SLIP:g} mm?')
            continue
        if patch.stroke > depth:
            yield Fault(pad.name, f'{name}: stroke_mm = {patch.stroke * MM:g}',
                        f'must be less than the {depth * MM:.3g} mm of body before it')
            continue
        pushed.append(patch)
    yield from _push_faults(pushed, scene.material, limits)


def _push_faults(patches, material, limits):
    """At most one: who cannot be pushed, by a flat round punch, 2 a d E / (1 - nu^2), in kind.

    Source: Johnson 1985, Contact Mechanics, sec. 3.4.
    """
    E = material.E
    if not limits.softest <= E <= limits.stiffest:
        return      # told of the material
    force = {p: 2.0 * E * p.radius * p.stroke / (1.0 - material.nu**2) for p in patches}
    odd = [p for p in patches if not limits.weakest <= force[p] <= limits.strongest]
    if odd:
        name, more = odd[0].name, f' and {len(odd) - 1} more' if len(odd) > 1 else ''
        yield Fault(name, f'pads {name}{more}: with E_kPa = {E * KPA:g} a push of '
                    f'{odd[0].stroke * MM:g} mm takes some {force[odd[0]]:.2g} N',
                    f'must be {limits.weakest:g} to {limits.strongest:g} N',
                    'is E in kPa, are radius and stroke in mm?')


def _load_faults(scene, body, limits):
    own = scene.material.density * float(np.sum(body.geometry.weights))
    for load in scene.loads:
        if load.mass and not limits.feather <= load.mass / own <= limits.load:
            yield Fault(load.name, f'loads {load.name}: mass_g = {load.mass * MM:g}', 'must be '
                        f'{limits.feather * own * MM:.2g} to {limits.load * own * MM:.2g} on a '
                        f'body of {own * MM:.3g} g', 'is it in grams?')
