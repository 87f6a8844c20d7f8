"""Model verification of chapter 3: each actuator alone pushes 5, 10, 15 mm; where do targets go?

Sec. 3.4.4 of the thesis: four actuators, three steps, so twelve experiments for each of the five
targets. It prints no numbers for them. The plant of Table 3.1 plays the phantom, through actuators
and EM tracker as they are; the model, the scene on its own mesh, sees the encoders.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm_brachy import cell as cells
from arm_brachy import registry
from arm_brachy.control.tissue_model import TissueModel
from arm_brachy.core.errors import NotConverged
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.term import Stage
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.scenario import Overlay, load_cell, resolve

NAME = 'model-verification'
SCENARIO = 'table_3_1.yaml'
STEPS = (5e-3, 10e-3, 15e-3)
# The slowest time constant of the plant is 2 s: after 10 s less than 1 % of its creep is to come.
HOLD = 10.0
AVERAGED = 1.0     # s at the end of a hold whose EM samples are averaged; 40 of them


@dataclass(frozen=True)
class Push:
    """One experiment: an actuator at a step, every target at once.

    measured, true, modelled : target name -> displacement from before the push (3,) [m]
    """

    pad: str
    step: float
    measured: dict
    true: dict
    modelled: dict


class Bench:
    """Actuators, plant and tracker, with a person instead of a controller."""

    def __init__(self, cell):
        """cell : scenario.Cell; every target of its scene carries an EM sensor."""
        self._tick, self._ticks = cell.tick_ns, 0
        self._directions = cells.pad_directions(cell.plant)
        self._driver = cells.build_actuators(cell, cell.scenario.actuators)
        self._body = cells.build_tissue(cell, 'plant')
        self._tracker = cells.build_em_tracker(cell, cell.scenario.em)
        self._feed = cells.PointFeed(cell.em_tools)
        self.targets, self._effort = cell.em_tools, None
        self._driver.connect()
        self._driver.home()

    def move(self, q):
        """Command the pads to q (p,) [m]."""
        self._driver.move(q)

    def hold(self, seconds):
        """Let time pass; returns (encoder (p,), true, measured: target -> (3,) [m]) at its end."""
        samples = {name: [] for name in self.targets}
        end = self._ticks + round(seconds * 1e9 / self._tick)
        while self._ticks < end:
            self._ticks += 1
            state = self._driver.read(self._ticks * self._tick * 1e-9, self._effort)
            reading = self._body.step(state.t, state.pad)
            self._effort = cells.push_back(reading.pad_force, self._directions)
            for sample in cells.em_samples(self._tracker, self._feed, reading):
                samples[sample.tool].append((sample.t, sample.position))
        points = dict(zip(reading.names, reading.points, strict=True))
        measured = {name: _mean_of_last(samples[name], state.t) for name in self.targets}
        return state.q, {name: points[name] for name in self.targets}, measured


def _mean_of_last(samples, now):
    return np.nanmean([p for t, p in samples if t > now - AVERAGED], axis=0)


def reproduce(out_dir):
    """Push with every actuator in turn; compare the model with EM measurement and with truth.

    out_dir : not used, no figure is drawn.  Returns Result, a row for each target, pad and step.
    """
    whole = load_cell(Path(config_dir() / 'scenarios' / SCENARIO))
    cell = resolve(replace(whole.scenario, tasks=(), model=Overlay()), whole.path)
    done = [push for pad in range(len(cell.scene.pads)) for push in pushes(cell, pad)]
    rows = [_row(push, target) for target in cell.em_tools for push in done]
    return Result(NAME, cell.scenario.seed, commit_of(share_dir()), machine_description(),
                  tuple(rows), tuple(_summary(rows, step) for step in STEPS))


def pushes(cell, pad):
    """The steps of one actuator (its index), on a body at rest before the first; yields Push."""
    bench, pads = Bench(cell), cell.scene.pads
    model = TissueModel(cell.model, registry.split(cell.model_terms)[Stage.BODY])
    q0, true0, measured0 = bench.hold(AVERAGED + 0.5)
    before = _modelled(model, q0, bench.targets)
    for step in STEPS:
        bench.move(step * (np.arange(len(pads)) == pad))
        q, true, measured = bench.hold(HOLD)
        after = _modelled(model, q, bench.targets)
        yield Push(pads[pad].name, step, *({n: now[n] - then[n] for n in bench.targets}
                                           for now, then in ((measured, measured0), (true, true0),
                                                             (after, before))))


def _modelled(model, q, targets):
    """Where the model has the targets at encoder travel q (p,) [m]; target -> (3,) [m]."""
    states = {name: model.evaluate(q, name) for name in targets}
    for state in states.values():
        if not state.outcome.ok:
            raise NotConverged(f'{NAME}: model at pad travel {q} m: {state.outcome.advice}')
    return {name: state.position for name, state in states.items()}


def _row(push, target):
    true, modelled = push.true[target], push.modelled[target]
    return {
        'target': target, 'pad': push.pad, 'step_mm': style.MM * push.step,
        'moved_mm': style.MM * float(np.linalg.norm(true)),
        'model_moved_mm': style.MM * float(np.linalg.norm(modelled)),
        'error_mm': style.MM * float(np.linalg.norm(modelled - true)),
        'error_em_mm': style.MM * float(np.linalg.norm(modelled - push.measured[target]))}


def _summary(rows, step):
    """Mean error at one step; the thesis prints none, so there is no goal to miss."""
    errors = [row['error_mm'] for row in rows if row['step_mm'] == style.MM * step]
    return Target(f'mean error of the model, {style.MM * step:g} mm steps',
                  float(np.mean(errors)), 'mm', 'not published', None)
