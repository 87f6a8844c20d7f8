"""Several scenes of one released body, which hangs another way or with other weights in each.

Test: diagnosis/test_free_scenes.py
"""

from collections import Counter
from dataclasses import replace

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


def loads_of(scenes):
    """The core.scene.PointLoads of all scenes, one for each place; a tuple."""
    return tuple({tuple(load.position): load for one in scenes for load in one.loads}.values())


def hung(scene, shifts):
    """The Scene with its i-th load farther by shifts[i] (3,) [m].

    A weight that would hang beside the body hangs where its surface is nearest (`load_masses`).
    """
    return replace(scene, loads=tuple(
        replace(load, position=tuple((np.array(load.position) + shift).tolist()))
        for load, shift in zip(scene.loads, shifts, strict=True)))


def acting(terms, name, scenes):
    """Those of `terms` that act in the scene of a name: a weight more where one of `scenes` has a
    load acts in those that have it there.
    """
    out = []
    for term in terms:
        at = [one.name for one in scenes if isinstance(term, PointMass) and any(
            tuple(load.position) == tuple(term.centre) for load in one.loads)]
        if not at or name in at:
            out.append(term)
    return tuple(out)


def along(terms, scene, moved):
    """`terms`, a weight more at a load of `scene` where that load is in `moved`."""
    to = {tuple(old.position): new.position
          for old, new in zip(scene.loads, moved.loads, strict=True)}
    return tuple(replace(term, centre=to.get(tuple(term.centre), term.centre))
                 if isinstance(term, PointMass) else term for term in terms)
