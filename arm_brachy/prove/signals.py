"""The generator's noise-free signals as its oracle sees them: effects, nuisances, whitened.

In mode 'null' the recording of the sound set-up is taken for exact: it is as long as the other, so
that effects are overrated by up to the square root of two.
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.prove.answering import ABSOLUTE
from arm_brachy.prove.generator.catalogue import Effect
from arm_brachy.prove.generator.form import REGISTRY
from arm_brachy.prove.generator.forms import act_of
from arm_brachy.prove.generator.history import law_of
from arm_brachy.prove.generator.make import SEEN
from arm_brachy.prove.generator.plant import build_world, pad_travel, with_memory
from arm_brachy.prove.generator.protocol import set_points
from arm_brachy.prove.generator.recorder import clean_streams
from arm_brachy.prove.generator.sensors import RATES
from arm_brachy.prove.oracle import whitened
from arm_brachy.prove.source import case_of

DT = 0.05                   # s between the instants looked at
MEMORY = 0.3                # s, of the coloured part of the sensors' noise
# Prior standard deviations of what every set-up has (generator.nuisance).
MODULUS, TOUCH, TURN, SLIDE = 0.15 / np.sqrt(3), 2e-4, np.deg2rad(0.3) / np.sqrt(3), 3e-4 / 3**0.5
EM_ZERO, FORCE_ZERO, CLOCK = 2e-4 / np.sqrt(3), 0.03, 2e-3 / np.sqrt(3)
# What a careful laboratory leaves, places of markers among it; a sound recording shows most of it.
CALIBRATION = Calibration()
STREAMS = ('forces', 'optical', 'em', 'encoders')
# What an actuator may be off by.
ACTUATORS = {'actuator_gain': {'gain': CALIBRATION.gain, 'offset_mm': 0.0},
             'actuator_compliance': {'compliance_mm_N': 1e3 * CALIBRATION.compliance},
             'backlash': {'width_mm': 1e3 * CALIBRATION.play}}
# What else one actuator may do in proportion to its push, at its typical size.
TWINS = {'actuator_gain': {'gain': 0.06, 'offset_mm': 0.0},
         'actuator_compliance': {'compliance_mm_N': 0.125}}


class Sight:
    """What can be seen of cases that share a body.

    jobs : plan.Job each;  cache : folder of solutions
    """

    def __init__(self, jobs, cache):
        self._cache = cache
        self._cases = {job.name: case_of(job) for job in jobs}
        self._worlds = {name: build_world(case, cache) for name, case in self._cases.items()}
        self._sound = build_world(next(iter(self._cases.values())).without_effect, cache)

    def label(self, job):
        """Names of what is planted, joined."""
        return ' + '.join(effect.name for effect in self._cases[job.name].effects)

    def is_rival(self, job):
        """True for a case with one effect that can be played in another's protocol at no cost.

        What tissue remembers would have to be integrated along every one of them.
        """
        effects = self._cases[job.name].effects
        return len(effects) == 1 and law_of(effects, 1.0) is None

    def effect(self, job, other):
        """Whitened effect (n,) of what is planted in `other`, in the set-up of `job`."""
        case = self._cases[job.name]
        return self._flat(case, self._play(case, self._cases[other.name].effects,
                                           self._worlds[other.name]), self._null(case))

    def twins(self, job):
        """(name, whitened effect (n,)) of what is most like the one thing planted, where it is.

        No other case need have it at the same actuator; without it a gain would count as told
        from a compliance because other cases have that elsewhere.
        """
        case = self._cases[job.name]
        first, *more = case.effects
        if more or first.values.get('gain', 0.0) > 0.0:
            return      # nothing that yields goes farther than it is sent
        for name, values in TWINS.items():
            if first.name in TWINS and first.name != name:
                twin = replace(first, name=name, form=REGISTRY,
                               values={**values, 'actuators': first.values['actuators']})
                played = self._play(case, (twin,), self._sound)
                yield name, self._flat(case, played, self._null(case))

    def nuisances(self, job, mode):
        """Whitened nuisances (n, k), a column each, times their prior standard deviations.

        mode : of answering; what stays the same in a sound recording is known beside it
        """
        case = self._cases[job.name]
        null, columns = self._null(case), []
        for i in range(len(case.body.pads)):
            moved = case.nuisances.touch + TOUCH * np.eye(len(case.body.pads))[i]
            touched = replace(case, nuisances=replace(case.nuisances, touch=moved))
            columns.append(self._null(touched))
        shifts = [*_shifts(null), *(_placements(null) if mode == ABSOLUTE else ())]
        columns += [{**null, name: null[name] + change} for name, change in shifts]
        return np.column_stack([self._flat(case, one, null) for one in columns])

    def tolerances(self, job, mode):
        """Whitened columns (n, k) of what a careful laboratory leaves and this generator does not.

        One tolerance of `finding.Calibration` each: nobody who answers can know that all of these
        happen to be perfect here. Directions of pushes and the base are left out.
        mode : as of `nuisances`
        """
        case = self._cases[job.name]
        null = self._null(case)
        shifts = [*_drifts(null), *(_scales(null) if mode == ABSOLUTE else ())]
        columns = [{**null, name: null[name] + change} for name, change in shifts]
        for name, values in ACTUATORS.items() if mode == ABSOLUTE else ():
            for pad in case.body.pads:
                one = Effect(name, {**values, 'actuators': [pad.name]}, 0.0)
                columns.append(self._play(case, (one,), self._sound))
        return np.column_stack([self._flat(case, one, null) for one in columns])

    def _null(self, case):
        return self._play(case, (), self._sound)

    def body(self, job):
        """The generator's Body of a job."""
        return self._cases[job.name].body

    def shown(self, job, effects=None):
        """(t (n,) [s], kind -> (names, (n, c, 3))) how what is planted changes what sensors show.

        effects : catalogue.Effects, None = those of the job
        t : of the generator, from the start of the protocol;  kind : of STREAMS but encoders
        """
        case, world = self._cases[job.name], self._worlds[job.name]
        if effects is not None:
            case = replace(case, effects=effects)
            world = build_world(case, self._cache)
        grid, streams = self._streams(case, case.effects, world)
        null = self._null(case)
        return grid, {name: (streams[name].names, _at(grid, streams[name]) - null[name])
                      for name in STREAMS if name != 'encoders'}

    def _play(self, case, effects, world):
        """Streams (t, k) or (t, k, 3) on the common clock of `effects` in a case's set-up."""
        grid, streams = self._streams(case, effects, world)
        return {name: _at(grid, streams[name]) for name in STREAMS}

    def _streams(self, case, effects, world):
        """(common clock (t,), name -> stream without noise) of `effects` in a case's set-up."""
        played = replace(case, effects=effects)
        world = replace(world, modulus=case.nuisances.modulus)
        t, u = set_points(case.protocol, world.response.strokes)
        grid = np.arange(0.5, t[-1] - 0.5, DT)
        y = pad_travel(played, world, t, u)
        world = with_memory(played, world.along(t, y), self._cache, t, y)
        streams = clean_streams(world, t, u, y, dict.fromkeys(RATES, (grid, grid)))
        for effect in effects:
            if effect.name in SEEN:
                act_of(effect, SEEN)(streams, effect.values)
        return grid, streams

    def _flat(self, case, streams, null):
        """Whitened difference (n,) of streams to those of nothing planted."""
        parts = []
        for name in STREAMS:
            # travel is seen by the markers on the pads as well as those see anything
            sd = case.sensors.noise['optical' if name == 'encoders' else name]
            change = (streams[name] - null[name]).reshape(len(null[name]), -1)
            parts.append(whitened(change, DT, sd, case.sensors.colour, MEMORY, RATES[name]))
        return np.concatenate([part.ravel() for part in parts])


def _at(grid, stream):
    """Values of a stream at the instants `grid` by its stamps, which an effect may have moved."""
    flat = stream.values.reshape(len(stream.values), -1)
    seen = np.column_stack([np.interp(grid, stream.stamps, column) for column in flat.T])
    return seen.reshape(stream.values.shape)


def _shifts(null):
    """(stream, change) for every nuisance but touch, one prior standard deviation each."""
    yield 'forces', MODULUS * null['forces']
    for axis in np.eye(3):
        yield 'optical', TURN * np.cross(axis, null['optical'])
        yield 'optical', SLIDE * axis
        yield 'em', EM_ZERO * axis
        for i in range(null['forces'].shape[1]):
            zero = np.zeros(null['forces'].shape[1:])
            zero[i] = FORCE_ZERO * axis
            yield 'forces', zero
    for name in ('forces', 'optical', 'em'):
        yield name, CLOCK * np.gradient(null[name], DT, axis=0)


def _placements(null):
    """('optical', change) for every marker and axis: a constant of one standard deviation."""
    yield from _constants(null, 'optical', CALIBRATION.placement)


def _constants(null, name, size):
    """(name, change) for every channel and axis of a stream: `size` at all times."""
    shape = null[name].shape[1:]
    for i in range(np.prod(shape)):
        yield name, size * np.eye(1, np.prod(shape), i).reshape(shape)


def _drifts(null):
    """('forces', change) for every pad and axis: a drift of one tolerance."""
    since = DT * np.arange(len(null['forces']))[:, None, None]
    for name, rate in _constants(null, 'forces', CALIBRATION.force_drift):
        yield name, since * rate


def _scales(null):
    """(stream, change) of one tolerance: where tools are, scale and axes of every force,
    scale of the tracker.
    """
    yield from _constants(null, 'em', CALIBRATION.em_registration)
    for i in range(null['forces'].shape[1]):
        only = np.arange(null['forces'].shape[1])[:, None] == i
        yield 'forces', CALIBRATION.force_gain * only * null['forces']
        for axis in np.eye(3):
            yield 'forces', CALIBRATION.sensor_axes * np.cross(axis, only * null['forces'])
    yield 'optical', CALIBRATION.scale * null['optical']
