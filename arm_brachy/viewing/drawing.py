"""From what the cell says to shapes: tissue, pads, markers, targets, goal, forces, instruments.

`Stage` holds what never changes; `Seen` what is known at one instant; `draw` and `draw_truth` turn
both into shapes. What a real cell cannot measure is drawn by `draw_truth` alone.
"""

from dataclasses import dataclass, field

import numpy as np

from arm_brachy.viewing.shapes import Kind, Shape

CHI2_95 = 7.815   # of three degrees of freedom: the 95 % ellipsoid (tables of chi-squared)
LEAST_FORCE = 0.02   # N, below which no arrow is drawn: the noise of the sensor
PAD_THICKNESS, MARKER, TARGET, ESTIMATE, HOLE = 4e-3, 4e-3, 5e-3, 3e-3, 1.2e-3   # m
SHAFT, NEEDLE, LETTER = 1.6e-3, 1.4e-3, 6e-3   # m
PROBE = (44e-3, 14e-3, 60e-3)   # m of the drawn head: a little more than its aperture
TEXT_LIFT = 5e-3   # m of a name above its point
SEE_THROUGH = 0.45
STEEL, PAD, WHITE = (0.55, 0.57, 0.6, 1.0), (0.16, 0.2, 0.24, 1.0), (0.95, 0.95, 0.95, 1.0)
MEASURED, TRUE, GOAL = (0.9, 0.45, 0.0, 1.0), (0.84, 0.15, 0.16, 1.0), (0.0, 0.6, 0.3, 1.0)
FORCE, PLANE = (0.8, 0.1, 0.5, 1.0), (0.3, 0.6, 0.9, 0.25)
ESTIMATED = {'kf_admm': (0.12, 0.47, 0.71), 'graph_vae': (0.58, 0.4, 0.74),
             'map': (0.1, 0.62, 0.6), 'pod': (0.55, 0.34, 0.29)}   # r g b of an estimator


@dataclass(frozen=True)
class Pad:
    """A disc: name, centre at zero travel (3,) [m], push direction (3,) unit, radius [m]."""

    name: str
    centre: np.ndarray
    direction: np.ndarray
    radius: float

    def at(self, travel):
        """Return its centre (3,) [m] after a travel [m]."""
        return self.centre + travel * self.direction


@dataclass(frozen=True)
class Stage:
    """What a cell draws with: its pads, the holes of its template, its image, its scales.

    holes : (k, 3) [m], empty without a template;  image : (width, depth) [m], None without
    full_colour : displacement [m] of the last colour;  arrow : [m/N]
    """

    pads: tuple = ()
    holes: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    image: tuple | None = None
    full_colour: float = 10e-3
    arrow: float = 5e-3


@dataclass(frozen=True)
class Seen:
    """What a cell has said, as known at one instant. World frame, SI; absent = not known.

    travel : pad -> [m] by its encoder;  forces : pad -> (3,) [N] of the tissue on it
    surface : (ThinSurface, x (n, 3)) of the estimator's mesh;  surface_from : whose it is
    markers : (k, 3) seen;  tools : EM tool -> (3,);  tip, needle_depth : pose (R, p), [m]
    estimates : (estimator, target) -> (place (3,), covariance (3, 3) [m2])
    goal : (where (3,), which target) while one is pursued
    probe : pose (R, p);  image_tip : (3,) as found in the image
    """

    travel: dict = field(default_factory=dict)
    forces: dict = field(default_factory=dict)
    surface: tuple | None = None
    surface_from: str = ''
    markers: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    tools: dict = field(default_factory=dict)
    estimates: dict = field(default_factory=dict)
    goal: tuple | None = None
    tip: tuple | None = None
    needle_depth: float = 0.0
    probe: tuple | None = None
    image_tip: np.ndarray | None = None


@dataclass(frozen=True)
class Truth:
    """What the simulated plant is, which no real cell could say.

    surface : (ThinSurface, x (n, 3));  targets : name -> (3,);  needle : (k, 3) its shaft
    """

    surface: tuple | None = None
    targets: dict = field(default_factory=dict)
    needle: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))


def draw(stage, seen):
    """Return the shapes of what a cell measures, estimates and wants, in a fixed order."""
    shapes = []
    if seen.surface is not None:
        shapes.append(tissue(f'tissue by {seen.surface_from}', stage, seen.surface))
    shapes += [_disc(pad, seen.travel.get(pad.name, 0.0)) for pad in stage.pads]
    shapes += [arrow for pad in stage.pads if pad.name in seen.forces
               for arrow in _force(stage, pad, seen)]
    if len(seen.markers):
        shapes.append(Shape('optical markers', Kind.SPHERES, seen.markers, WHITE, MARKER))
    shapes += _points('EM sensors', seen.tools, MEASURED, TARGET)
    shapes += [one for key, value in sorted(seen.estimates.items()) for one in _estimate(
        *key, *value)]
    if seen.goal is not None:
        shapes += _points('goal', {f'goal of {seen.goal[1]}': seen.goal[0]}, GOAL, TARGET)
    if len(stage.holes):
        shapes.append(Shape('template', Kind.DOTS, stage.holes, STEEL, HOLE))
    return shapes + _instruments(stage, seen)


def draw_truth(stage, truth):
    """Return the shapes of the simulated plant, whose layers all begin with `true`."""
    shapes = []
    if truth.surface is not None:
        shapes.append(tissue('true tissue', stage, truth.surface))
    shapes += _points('true targets', truth.targets, TRUE, 0.8 * TARGET)
    if len(truth.needle) > 1:
        shapes.append(Shape('true needle', Kind.LINE, truth.needle, TRUE, NEEDLE))
    return shapes


def tissue(layer, stage, surface):
    """A surface coloured by displacement. surface : (ThinSurface, x (n, 3) [m])."""
    thin, x = surface
    corners, moved = thin.shape(x)
    return Shape(layer, Kind.TRIANGLES, corners, (1.0, 1.0, 1.0, SEE_THROUGH),
                 triangles=thin.triangles, shades=moved / stage.full_colour)


def frame_along(axis):
    """Return axes (3, 3) whose z is `axis` (3,)."""
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def ellipsoid(covariance):
    """Return axes (3, 3), right-handed, and diameters (3,) [m] of the 95 % ellipsoid."""
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return axes, 2.0 * np.sqrt(CHI2_95 * np.maximum(variances, 0.0))


def _disc(pad, travel):
    behind = pad.at(travel) - 0.5 * PAD_THICKNESS * pad.direction
    return Shape('pads', Kind.DISC, behind[None], PAD, axes=frame_along(pad.direction),
                 scale=(2.0 * pad.radius, 2.0 * pad.radius, PAD_THICKNESS))


def _force(stage, pad, seen):
    force = np.asarray(seen.forces[pad.name])
    if np.linalg.norm(force) < LEAST_FORCE:
        return
    centre = pad.at(seen.travel.get(pad.name, 0.0))
    yield Shape('pad forces', Kind.ARROW, np.array([centre, centre + stage.arrow * force]), FORCE,
                SHAFT)


def _points(layer, named, colour, size):
    """A sphere per name, and the name beside it."""
    if not named:
        return []
    points = np.array([named[name] for name in named])
    return [Shape(layer, Kind.SPHERES, points, colour, size),
            *(Shape(f'{layer}: names', Kind.TEXT, p[None] + [0.0, 0.0, TEXT_LIFT], colour, LETTER,
                    text=name) for name, p in zip(named, points, strict=True))]


def _estimate(estimator, target, place, covariance):
    colour, layer = ESTIMATED[estimator], f'estimates by {estimator}'
    axes, diameters = ellipsoid(covariance)
    yield Shape(layer, Kind.SPHERES, place[None], (*colour, 1.0), ESTIMATE)
    yield Shape(f'{layer}: 95 % ellipsoids', Kind.ELLIPSOID, place[None], (*colour, 0.3),
                axes=axes, scale=tuple(diameters))


def _instruments(stage, seen):
    shapes = []
    if seen.tip is not None:
        R, p = seen.tip
        shapes.append(Shape('needle', Kind.LINE, np.array([p - seen.needle_depth * R[:, 2], p]),
                            STEEL, NEEDLE))
    if seen.image_tip is not None:
        shapes += _points('tip in the image', {'tip in the image': seen.image_tip}, MEASURED,
                          ESTIMATE)
    if seen.probe is not None:
        R, p = seen.probe
        shapes.append(Shape('probe', Kind.BOX, (p - 0.5 * PROBE[2] * R[:, 2])[None], STEEL,
                            axes=R, scale=PROBE))
        if stage.image is not None:
            shapes.append(_plane(R, p, *stage.image))
    return shapes


def _plane(R, p, width, depth):
    """The image: x along the elements, z deep, as a rectangle of two triangles."""
    side, deep = 0.5 * width * R[:, 0], depth * R[:, 2]
    corners = np.array([p - side, p + side, p + side + deep, p - side + deep])
    return Shape('image plane', Kind.TRIANGLES, corners, PLANE,
                 triangles=np.array([[0, 1, 2], [0, 2, 3]]))
