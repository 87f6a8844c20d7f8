"""Where a cause is: actuator, stream, boundary or position with its 90 % region."""

import numpy as np
from scipy.stats import chi2

from arm_brachy.core.term import Kind
from arm_brachy.diagnosis.results.parts import Place
from arm_brachy.diagnosis.selection.pad_rotation_tests import Turn
from arm_brachy.diagnosis.selection.pooled_misfit_tests import Past
from arm_brachy.diagnosis.signals.stream import FORCE

SHARE = 0.9
BOUNDARIES = {'base_debond': 'base', 'base_compliance': 'base', 'breathing': 'base',
              'obstacle': 'surface', 'external_force': 'surface', 'point_mass': 'surface',
              'reference_shape': 'surface', 'skin_layer': 'surface'}
CENTRES = ('centre', 'bump_centre')


def place_of(term, scene, spread=None):
    """statements.Place of a term of the registry, as it was found; None if it is everywhere.

    scene : core.scene.Scene;  spread : (3, 3) [m^2] covariance of its centre, None = no centre
    """
    name, kind = term.spec.name, term.spec.kind
    said = {'term': name}
    if spread is not None:
        centre = next(getattr(term, key) for key in CENTRES if hasattr(term, key))
        return Place(boundary=BOUNDARIES.get(name, ''), position=tuple(map(float, centre)),
                     radius=radius_of(spread), **said)
    if name in BOUNDARIES and name != 'skin_layer':
        return Place(boundary=BOUNDARIES[name], **said)
    actuators, pads = getattr(term, 'actuators', ()), getattr(term, 'pads', ())
    if len(actuators) == 1:
        return Place(actuator=scene.pads[actuators[0]].name, **said)
    if kind is Kind.SENSING:
        channel = getattr(term, 'marker', '') or next(iter(
            (*pads, *getattr(term, 'tools', ()))), '')
        return Place(stream=getattr(term, 'stream', term.stage.value), channel=channel, **said)
    if len(pads) == 1:
        return Place(boundary=under(pads[0]), **said)
    return None


def under(pad):
    """The boundary where a pad of that name meets the body."""
    return f'surface under {pad}'


def radius_of(covariance):
    """[m] of the ball around the mean that holds 90 % of a normal place, by its widest axis."""
    widest = float(np.linalg.eigvalsh(covariance)[-1])
    return float(np.sqrt(max(widest, 0.0) * chi2.ppf(SHARE, 3)))


def places_of_test(label):
    """statements.Place of a structured test that stands out, by its label; a tuple.

    Of a history also the pad whose pushes it is of, if that is another place.
    """
    if isinstance(label, Turn):
        return (Place(actuator=label.pad),)
    if not isinstance(label, Past):
        (kind, channel, _), _ = label
        return (Place(stream=kind, channel=channel),)
    if label.sensor:
        return (Place(stream=FORCE, channel=label.sensor),)
    pads = tuple(Place(actuator=name) for name in dict.fromkeys((label.moved, label.pad)) if name)
    if label.centre is None:
        return pads
    return (Place(position=label.centre, radius=label.radius), *pads)


def marker_place(scene, weights):
    """Place around the markers that an unexplained residual moves most; None without them.

    weights : marker name -> size of what is left
    It says where to look, not what is there.
    """
    at = {m.name: np.array(m.position) for m in scene.markers}
    some = [(at[name], w) for name, w in weights.items() if name in at and w > 0.0]
    if not some:
        return None
    points, w = np.array([p for p, _ in some]), np.array([w for _, w in some])
    w = (w / w.max())**4        # the loudest decide
    centre = w @ points / w.sum()
    far = np.linalg.norm(points - centre, axis=1)
    radius = float(np.sqrt(w @ far**2 / w.sum())) or _nearest(centre, at)
    return None if radius is None else Place(position=tuple(map(float, centre)), radius=radius)


def _nearest(point, at):
    """Distance [m] from a marker to the next, name -> place; None if there is no other."""
    far = np.linalg.norm(np.array(list(at.values())) - point, axis=1)
    return float(far[far > 0.0].min()) if (far > 0.0).any() else None
