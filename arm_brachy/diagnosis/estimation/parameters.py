"""Which numbers of a hypothesis are free, each on a scale on which its prior is standard normal.

Priors are those of the terms: normal, lognormal in the logarithm, uniform ones as the normal of
the same mean and variance, as where responses are judged (`Strength.spread`). A place without a
prior is anywhere in the body; one given on its surface moves on the surface.
Test: diagnosis/forward/test_refit.py
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.stats import truncnorm

from arm_brachy.core.quantity import quantities
from arm_brachy.diagnosis.model.hypothesis import strengths
from arm_brachy.diagnosis.results.cause import Estimate
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.triangle import closest_points

NEAR = 1e-3         # m by which places are moved for a difference: a share of any element
FAR = 1e-2          # m that one step of a fit may move them: as far as a lump is wide
STEP = 0.02         # for a difference, in prior standard deviations, but for
STEPS = {'radius': 0.1, 'bump_radius': 0.1, 'thickness': 0.1,   # seen by points of quadrature
         'frequency': 1e-3}                                     # times the length of a recording
LONGEST = 2.0       # prior standard deviations that one step of a fit may take
HALF = 1.6449       # standard deviations on either side that hold 90 %
FAINT = -2.0        # prior standard deviations: start of a positive number given as none
# Numbers that say nothing while a strength of their term is off.
IDLE_WITHOUT = {'bump_centre': 'bump_height', 'bump_radius': 'bump_height', 'tau1': 'g1',
                'tau2': 'g2', 'centre': 'gradient', 'extent': 'gradient'}
# Places that stay where they were tried. A piece of metal that may be anywhere has some place at
# which it does whatever one tool alone does: of a tool on a taut lead it took 145 nats more.
TRIED = ('metal',)


@dataclass(frozen=True)
class Chart:
    """One field of a term in k coordinates z, of standard normal prior.

    number : of its hypothesis;  field : of the term;  place : natural coordinates (k,) -> SI
    origin, scale : (k,) natural = origin + scale z;  start, low, high : (k,) of z
    step : (k,) of z for differences;  reach : (k,) longest step of a fit
    """

    number: int
    field: str
    place: callable
    origin: np.ndarray
    scale: np.ndarray
    start: np.ndarray
    low: np.ndarray
    high: np.ndarray
    step: np.ndarray
    reach: np.ndarray

    def value(self, z):
        """The field (SI float or (3,) tuple) at z (k,)."""
        return self.place(self.origin + self.scale * z)

    def estimate(self, z, mean, covariance):
        """Return the Estimate at z (k,), given the normal (k,), (k, k) whose limits cut it off."""
        sd = np.sqrt(np.diag(covariance))
        if len(z) == 1:
            low, high = (self.value(np.array([end])) for end in _between(
                z[0], mean[0], sd[0], self.low[0], self.high[0]))
            return Estimate(self.value(z), low, high)
        value = np.array(self.value(z))
        slope = np.stack([np.subtract(self.value(z + h), self.value(z - h)) / (2.0 * step)
                          for h, step in zip(np.diag(self.step), self.step, strict=True)], axis=1)
        half = HALF * np.sqrt(np.diag(slope @ covariance @ slope.T))
        return Estimate(*(tuple(map(float, v)) for v in (value, value - half, value + half)))


def _between(z, mean, sd, low, high):
    """Ends of the 90 % interval of a normal between limits, z in it."""
    cut = truncnorm((low - mean) / sd, (high - mean) / sd, mean, sd)
    return min(float(cut.ppf(0.05)), z), max(float(cut.ppf(0.95)), z)


@dataclass(frozen=True)
class Space:
    """All free numbers of several hypotheses as one vector z.

    fixed : per hypothesis (term class, field -> SI value of what is not free)
    charts : tuple of Chart, in the order of z
    """

    fixed: tuple
    charts: tuple

    def joined(self, name):
        """The arrays `start`, `low`, `high`, `step` or `reach` of all charts, (k,)."""
        return np.concatenate([getattr(chart, name) for chart in self.charts])

    @property
    def owner(self):
        """(k,) number of the hypothesis of every coordinate."""
        return np.repeat([c.number for c in self.charts], [len(c.start) for c in self.charts])

    @property
    def slices(self):
        """Where each chart has its coordinates."""
        ends = np.cumsum([0, *(len(chart.start) for chart in self.charts)])
        return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]

    def terms(self, z):
        """Return the terms at z, one per hypothesis. Raises as terms refuse their values."""
        values = [dict(fixed) for _, fixed in self.fixed]
        for chart, part in zip(self.charts, self.slices, strict=True):
            values[chart.number][chart.field] = chart.value(z[part])
        return tuple(cls(**own) for (cls, _), own in zip(self.fixed, values, strict=True))

    def estimates(self, z, mean, covariance):
        """Return hypothesis number -> {field: Estimate}; arguments as of `Chart.estimate`."""
        out = {number: {} for number in range(len(self.fixed))}
        for chart, part in zip(self.charts, self.slices, strict=True):
            out[chart.number][chart.field] = chart.estimate(z[part], mean[part],
                                                            covariance[part, part])
        return out


def free_space(hypotheses, amplitudes, specimen, held=()):
    """Return the Space of hypothesis.Hypotheses, to start from their places and amplitudes.

    amplitudes : per hypothesis (k,), of its strengths in typical sizes, moved inside their limits
    specimen : specimen.Specimen, for the size and the surface of the body
    held : names of fields that stay at their place or default
    Free are the strengths, continuous places, and whatever else has a prior. When something sets
    in or ends at once is not: states at single instants do not change with it.
    """
    fixed, charts = [], []
    for number, (one, given) in enumerate(zip(hypotheses, amplitudes, strict=True)):
        start = _values(one, given)
        free = [name for name in quantities(one.cls) if name not in held and _is_free(one, name)]
        charts += [_chart(number, one, name, start[name], specimen) for name in free]
        fixed.append((one.cls, {k: v for k, v in start.items() if k not in free}))
    return Space(tuple(fixed), tuple(charts))


def _values(one, amplitudes):
    """SI values of all strengths of a Hypothesis, of its place and of numbers by default."""
    values = {f.name: f.default for f in dataclasses.fields(one.cls) if f.name in
              quantities(one.cls) and f.default is not dataclasses.MISSING}
    given = {(s.name, s.component): a for s, a in zip(one.strengths, amplitudes, strict=True)}
    for strength in strengths(one.cls):
        value = strength.value(given.get((strength.name, strength.component), 0.0))
        if strength.component is not None:
            before = values[strength.name]
            value = (*before[:strength.component], value, *before[strength.component + 1:])
        values[strength.name] = value
    return {**values, **one.place}


def _is_free(one, name):
    info = quantities(one.cls)[name]
    active = {s.name for s in one.strengths}
    if info.neutral is not None:
        return name in active
    if name in TRIED:
        return False
    if name in ('onset', 'duration') and 'rate' not in quantities(one.cls):
        return False
    needed = IDLE_WITHOUT.get(name)
    if needed in one.cls.__dataclass_fields__ and needed not in active:
        return False
    return name in one.place or info.prior is not None


def _chart(number, one, name, start, specimen):
    """The Chart of a free field that starts at an SI value, moved inside its limits."""
    info = quantities(one.cls)[name]
    if info.prior is not None:
        return _by_prior(number, name, info, start)
    start = np.array(start)
    if name == 'direction':
        return _on_sphere(number, name, start / np.linalg.norm(start))
    faces = boundary_faces(specimen.mesh)
    base = np.isin(faces, specimen.body.fixed).all(axis=1)
    away = [np.linalg.norm(_nearest(specimen.mesh.nodes[some], start) - start)
            if len(some) else np.inf for some in (faces[base], faces[~base])]
    if min(away) > NEAR:
        return _in_box(number, name, start, specimen.mesh.nodes)
    return _on_surface(number, name, start,
                       specimen.mesh.nodes[faces[base == (away[0] < away[1])]])


def _by_prior(number, name, info, start):
    kind, a, b = info.prior
    least, most = (np.inf * sign if limit is None else info.scale * limit
                   for limit, sign in ((info.low, -1.0), (info.high, 1.0)))
    low, high = least, most
    if kind == 'lognormal':
        origin, scale = np.log(info.scale * a), np.log(b)
        start = np.log(start) if start > 0.0 else origin + FAINT * scale
        low, high = np.log(least) if least > 0.0 else -np.inf, np.log(most)
    else:
        mean, sd = (a, b) if kind == 'normal' else (0.5 * (a + b), (b - a) / np.sqrt(12.0))
        origin, scale = info.scale * mean, info.scale * sd
    low, high = (low - origin) / scale, (high - origin) / scale
    k = info.shape[0] if info.shape else 1
    z = np.clip((np.atleast_1d(start) - origin) / scale, low, high)

    def place(natural):
        # rounding must not step over a limit
        values = np.clip(np.exp(natural) if kind == 'lognormal' else natural, least, most)
        return tuple(map(float, values)) if info.shape else float(values[0])

    return Chart(number, name, place, np.full(k, origin), np.full(k, scale), z,
                 np.full(k, low), np.full(k, high),
                 np.full(k, STEPS.get(name, STEP)), np.full(k, LONGEST))


def _in_box(number, name, start, nodes):
    """Anywhere between the ends of the body along each axis."""
    least, most = nodes.min(axis=0), nodes.max(axis=0)
    origin, scale = 0.5 * (least + most), (most - least) / np.sqrt(12.0)
    z = np.clip((start - origin) / scale, (least - origin) / scale, (most - origin) / scale)
    return Chart(number, name, _tuple, origin, scale, z, (least - origin) / scale,
                 (most - origin) / scale, NEAR / scale, FAR / scale)


def _on_surface(number, name, start, corners):
    """On triangles (f, 3, 3), nearest to points of the plane that touches them at the start."""
    triangle = corners[np.linalg.norm(
        closest_points(corners, start) - start,
        axis=1).argmin()]
    along = np.linalg.qr((triangle[1:] - triangle[0]).T)[0]
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    scale = np.full(2, size / np.sqrt(12.0))
    limit = size / scale
    return Chart(number, name, lambda natural: _tuple(_nearest(corners, start + along @ natural)),
                 np.zeros(2), scale, np.zeros(2), -limit, limit, NEAR / scale, FAR / scale)


def _on_sphere(number, name, start):
    """Unit vectors about one, a turn by 45 degrees being one standard deviation."""
    along = np.linalg.svd(start[None])[2][1:].T

    def place(natural):
        there = start + along @ natural
        return _tuple(there / np.linalg.norm(there))

    return Chart(number, name, place, np.zeros(2), np.ones(2), np.zeros(2), np.full(2, -np.inf),
                 np.full(2, np.inf), np.full(2, STEP), np.full(2, LONGEST))


def _nearest(corners, point):
    """Point (3,) of triangles (f, 3, 3) nearest to a point."""
    found = closest_points(corners, point)
    return found[np.linalg.norm(found - point, axis=1).argmin()]


def _tuple(values):
    return tuple(map(float, values))
