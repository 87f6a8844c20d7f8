"""What tissue, markers and pads really do at given times and travels, effects included."""
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.prove.generator.body import Body
from arm_brachy.prove.generator.response import Response


@dataclass(frozen=True)
class Change:
    """Difference of two coarse responses, times a weight (t,) of time and travels (t, p).

    The error of the coarse mesh is common to both, so what is left is relative to the effect.
    """

    difference: Response
    weight: Callable

    def read(self, t, y):
        """Change of outputs (t, o)."""
        return np.asarray(self.weight(t, y))[:, None] * self.difference.read(y)

    def along(self, t, y):
        """This change in a run with travels y (t, p) at times t (t,), weighted by its past."""
        weight = np.asarray(self.weight(t, y))
        return replace(self, weight=lambda at, _: np.interp(at, t, weight))


@dataclass(frozen=True)
class World:
    """Body in one case.  modulus: true over labelled; changes: what effects add, each with
    `read(t, y)`; stiffen: factor (t,) on all forces; base: displacement (t, 3) of the base [m];
    touch: travel (t, p) that tissue sees of pads at travel (t, p); pads: where they really are.
    """

    body: Body
    response: Response
    modulus: float
    changes: tuple
    stiffen: Callable
    base: Callable
    touch: Callable
    pads: tuple

    def outputs(self, t, y):
        """Displacements (t, k, 3) [m] of tissue points and forces on pads (t, p, 3) [N]."""
        seen = self.touch(t, y)
        out = self.response.read(seen)
        for change in self.changes:
            out = out + change.read(t, seen)
        moved, force = self.response.split(out)
        return moved, force * (self.modulus * self.stiffen(t))[:, None, None]

    def along(self, t, y):
        """This world in one run: effects that depend on the past follow this one."""
        seen = self.touch(t, y)
        lost = y - seen
        return replace(self, changes=tuple(c.along(t, seen) for c in self.changes),
                       touch=lambda at, z: z - columns_at(at, t, lost))

    def push_back(self, t, y):
        """Force against the pads (t, p) [N], along their directions."""
        directions = np.array([pad.direction for pad in self.pads])
        return -np.einsum('tpi,pi->tp', self.outputs(t, y)[1], directions)

    def markers(self, t, y):
        """True positions (t, m, 3) [m] of optical markers: on tissue, pads and base."""
        body = self.body
        count = len(body.surface_markers)
        tissue = body.points[:count] + self.outputs(t, y)[0][:, :count]
        directions = np.array([pad.direction for pad in self.pads])
        pads = pad_markers(self.pads) + y[:, :, None] * directions
        base = np.array(body.base_markers) + self.base(t)[:, None]
        return np.concatenate([tissue, pads, base], axis=1)

    def targets(self, t, y):
        """True positions (t, k, 3) [m] of the targets."""
        count = len(self.body.surface_markers)
        return self.body.points[count:] + self.outputs(t, y)[0][:, count:]


def columns_at(times, t, values):
    """Columns of values (n, p) on the fine clock t (n,) at `times`."""
    return np.column_stack([np.interp(times, t, c) for c in values.T])


def pad_markers(pads, behind=0.008):
    """Markers (p, 3) [m] on the backs of retracted pads."""
    return np.array([np.array(p.centre) - behind * np.array(p.direction) for p in pads])


def marker_names(body):
    """Names of the optical markers, in the order of `World.markers`."""
    tissue = [f'tissue_{i + 1:02d}' for i in range(len(body.surface_markers))]
    pads = [f'on_{pad.name}' for pad in body.pads]
    return (*tissue, *pads, *(f'base_{i + 1}' for i in range(3)))


def target_names(body):
    """Names of the targets."""
    return tuple(f'target_{i + 1}' for i in range(len(body.targets)))
