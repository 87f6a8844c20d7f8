"""How the forces of a baseline's body change, its positions held, where a term makes it another.

Test: diagnosis/forward/test_responses.py
"""

import dataclasses
from dataclasses import replace
from functools import cached_property

import numpy as np

from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Fibres

PER_ELEMENT = ('mu', 'kappa', 'density', 'stiffening')
PER_ELEMENT_NOW = ('mu', 'kappa', 'beyond', 'stress')
FEW = 0.4   # of all elements: two loops over more are no gain


class Rates:
    """Changes of `Assembler.forces` at the states of a linearised.Baseline.

    body : SoftBody, alike but for what a tangent leads to;  shift : (n, 3) [m] of its nodes
    Where the shape alone differs, of a few elements, the others are left out.
    """

    def __init__(self, baseline, body):
        self._baseline, self._body, self._old = baseline, body, baseline.model.body
        self.shift = body.mesh.nodes - self._old.mesh.nodes
        self._same = alike(body, self._old, but=('pads',))
        moved = self.shift.any(axis=1)[self._old.mesh.connectivity].any(axis=1)
        self._moved = np.flatnonzero(moved)
        self._local = (0.0 < moved.mean() <= FEW
                       and alike(body, self._old, but=('pads', 'mesh', 'scene_nodes')))

    def at(self, i, fields):
        """Return the change (n, 3) [N] at state i with StepFields, positions moved by `shift`."""
        before, x = self._baseline.fields[i], self._baseline.x(i)
        if self._same and same_fields(before, fields, but=('nodal_force',)):
            return before.nodal_force - fields.nodal_force
        if self._local and same_fields(before, fields):
            part, (old, new) = _part(fields, self._moved, PER_ELEMENT_NOW), self._parts
            return new.forces(x + self.shift, part) - old.forces(x, part)
        return self._whole.forces(x + self.shift, fields) - self._baseline.forces[i]

    @cached_property
    def _whole(self):
        return self._baseline.solver.assembler if self._same else Assembler(self._body)

    @cached_property
    def _parts(self):
        """Assemblers of the elements that differ, before and after."""
        return tuple(Assembler(_elements_of(body, self._moved))
                     for body in (self._old, self._body))


def _elements_of(body, elements):
    """The SoftBody with some of its elements alone, its nodes and what hangs on them all."""
    mesh, fibres = body.mesh, body.fibres
    midside = None if mesh.midside is None else mesh.midside[elements]
    if fibres is not None:
        fibres = Fibres(fibres.modulus[elements], fibres.direction[elements])
    return replace(_part(body, elements, PER_ELEMENT), fibres=fibres, mesh=replace(
        mesh, tets=mesh.tets[elements], midside=midside))


def _part(one, elements, names):
    """A SoftBody or StepFields with what is per element for some elements only."""
    values = {name: getattr(one, name) for name in names}
    return replace(one, **{name: None if value is None else value[elements]
                           for name, value in values.items()})


def same_fields(one, other, but=()):
    """True if two StepFields are the same, save what is named in `but`."""
    return one is other or all(
        _same(getattr(one, f.name), getattr(other, f.name))
        for f in dataclasses.fields(one) if f.name not in but)


def _same(one, other):
    return one is other or np.array_equal(one, other)


def alike(one, other, but=()):
    """True if two SoftBodies share all parts, save what is named in `but`."""
    return all(getattr(one, f.name) is getattr(other, f.name)
               for f in dataclasses.fields(one) if f.name not in but)
