"""Several scenes of one released body, which hangs another way or with other weights in each.

Test: diagnosis/test_free_scenes.py
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.scene import Scene
from arm_brachy.tissue.terms.point_mass import PointMass

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
