"""Several scenes of one released body, which hangs another way or with other weights in each.

Test: diagnosis/test_free_scenes.py
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.scene import Scene
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.registration import register
from arm_brachy.diagnosis.signals.stream import OPTICAL, TISSUE
from arm_brachy.tissue.terms.point_mass import PointMass

LAST = 0.1          # of a recording, in which all has settled
SHALLOWER = 0.8     # of the sag under less weight: markers are placed to millimetres, sags are
                    # centimetres
OWN = ('name', 'gravity', 'loads', 'description', 'source')     # may differ


def refuse_other_bodies(scenes):
    """Raise InputError unless all core.scene.Scene are of one body, under different names."""
    first, *others = dict.fromkeys(scenes)
    twice = [name for name, count in Counter(s.name for s in (first, *others)).items()
             if count > 1]
    if twice:
        raise InputError(f'scenes of the name {twice[0]} that differ; must have a name each: give '
                         'the one with other loads another')
    for other in others:
        same = replace(other, **{key: getattr(first, key) for key in OWN})
        odd = [key for key in Scene.__dataclass_fields__
               if getattr(same, key) != getattr(first, key)]
        if odd:
            raise InputError(f'scenes {first.name} and {other.name} differ in {", ".join(odd)}; '
                             f'recordings told together must be of one body, whose scenes differ '
                             f'in {", ".join(OWN[:3])} alone')


def refuse_exchanged(evidences):
    """Raise InputError where the body hangs deeper in the scene with less on it.

    evidences : loading.Evidence of bodies that were let go, of `refuse_other_bodies`
    Compared are scenes of one gravity of which one has all loads of the other, some heavier, by
    the mean distance of the markers on the tissue from their stress-free places when all has
    settled, in the frame of the markers on the base. One body under more weight hangs deeper,
    whatever it is made of: if it does not, by SHALLOWER, the scenes are exchanged.
    """
    sags = {}
    for one in evidences:
        sag = _sag(one)
        if sag is not None:
            sags.setdefault(one.scene, []).append((sag, one.name))
    for light, some in sags.items():
        for heavy, others in sags.items():
            if not _carries_more(heavy, light):
                continue
            (least, name), (most, other) = max(some), min(others)
            if most < SHALLOWER * least:
                raise InputError(
                    f'{other} hangs {1e3 * most:.3g} mm from the stress-free shape in scene '
                    f'{heavy.name}, {name} {1e3 * least:.3g} mm in {light.name}, which has less '
                    'weight on it; must hang deeper under more: exchange the scenes of these '
                    'recordings')


def _carries_more(one, other):
    """True if scene `one` has the loads of `other` at their places, some heavier or one more."""
    mass = [{tuple(load.position): load.mass for load in scene.loads} for scene in (one, other)]
    return (one.gravity == other.gravity and mass[0] != mass[1]
            and all(mass[0].get(place, -1.0) >= m for place, m in mass[1].items()))


def _sag(evidence):
    """[m] mean distance of tissue markers from their stress-free places at the end, or None."""
    optical = evidence.get(OPTICAL)
    found = None if optical is None else register(evidence, Calibration().placement)
    if found is None or not found.on:
        return None
    start, stop = evidence.span
    tissue = optical.channels(optical.on(TISSUE)).between(stop - LAST * (stop - start), stop)
    if not len(tissue.t) or not tissue.valid.any(axis=0).all() or not len(tissue.names):
        return None
    places = found.apply(np.nanmedian(tissue.values, axis=0))
    return float(np.linalg.norm(places - tissue.rest, axis=1).mean())


@dataclass(frozen=True)
class InScene:
    """A term that acts in the scene of a name alone."""

    term: object
    scene: str


def at_loads(scenes):
    """Place (x, y, z) [m] -> names of the core.scene.Scenes that have a load there, each once."""
    found = {}
    for one in dict.fromkeys(scenes):
        for load in one.loads:
            found.setdefault(tuple(load.position), []).append(one.name)
    return {where: tuple(dict.fromkeys(names)) for where, names in found.items()}


def hung(scene, shifts):
    """The Scene with its i-th load farther by shifts[i] (3,) [m].

    A weight that would hang beside the body hangs where its surface is nearest (`load_masses`).
    """
    return replace(scene, loads=tuple(
        replace(load, position=tuple((np.array(load.position) + shift).tolist()))
        for load, shift in zip(scene.loads, shifts, strict=True)))


def acting(terms, name, scenes):
    """Those of `terms` that act in the scene of a name: an InScene in its own, a weight more where
    one of `scenes` has a load in those that have it there.
    """
    there, out = at_loads(scenes), []
    for term in terms:
        if isinstance(term, InScene):
            out += [term.term] if term.scene == name else []
            continue
        at = there.get(tuple(term.centre), ()) if isinstance(term, PointMass) else ()
        if not at or name in at:
            out.append(term)
    return tuple(out)


def along(terms, scene, moved):
    """`terms`, a weight more at a load of `scene` where that load is in `moved`."""
    to = {tuple(old.position): new.position
          for old, new in zip(scene.loads, moved.loads, strict=True)}
    return tuple(replace(term, centre=to.get(tuple(term.centre), term.centre))
                 if isinstance(term, PointMass) else term for term in terms)
