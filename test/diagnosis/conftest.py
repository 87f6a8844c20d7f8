"""Made-up answers, one for each kind of verdict, on the breast phantom; and what is drawn."""

import numpy as np
import pytest

from arm_brachy.control.moves import Move, PadTarget
from arm_brachy.core.paths import config_dir
from arm_brachy.core.random import stream
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.report.answer import Diagnosis, Provenance
from arm_brachy.diagnosis.report.figures import Trace, body_of
from arm_brachy.diagnosis.report.page import Shown
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.results.finding import Finding
from arm_brachy.diagnosis.results.parts import (
    Alternative,
    Interval,
    Limit,
    Nearest,
    NextExperiment,
    Place,
    Recording,
    StreamFit,
)
from arm_brachy.tissue.mesh import load_mesh

SCENE = config_dir() / 'scenes' / 'breast.yaml'
MESH = config_dir() / 'scenes' / 'breast' / 'breast_600.msh'
SPAN = (0.0, 62.0)      # s
TOUCH = (23.4, 27.2)    # s
NOISE = {'optical': 0.15e-3, 'em': 0.3e-3, 'force': 0.03}


def source(name, *recordings):
    return Provenance(name, 20260211, '3ccca86', '2 cores, an example', str(SCENE), tuple(
        Recording(r, role, *SPAN) for r, role in recordings),
        f'arm-brachy diagnose {" ".join(r for r, _ in recordings)} --scene breast.yaml')


def named():
    return Diagnosis(
        'named', source('lump', ('slow', 'fitted'), ('pairs', 'held out')),
        causes=(Cause('inclusion', {
            'centre': Estimate((18.2e-3, 8.1e-3, 28.4e-3), (16.0e-3, 6.2e-3, 25.9e-3),
                               (20.4e-3, 10.0e-3, 30.9e-3)),
            'radius': Estimate(9.3e-3, 7.1e-3, 11.8e-3), 'ratio': Estimate(5.6, 2.9, 12.4)},
            probability=0.9993),),
        where=(Place(position=(18.2e-3, 8.1e-3, 28.4e-3), radius=3.1e-3, term='inclusion'),),
        when=(Interval('slow', 8.0, 31.5, 'amplitude', term='inclusion'),
              Interval('pairs', 5.0, 22.0, 'amplitude', term='inclusion')),
        alternatives=(Alternative(('stiffness_gradient',), 31.4),
                      Alternative(('obstacle',), 12.8), Alternative(('strain_stiffening',), -2.4),
                      Alternative(('pad_slip',), 0.0, visible=False)),
        fit=(StreamFit('optical', 0.62e-3, 0.41e-3, 0.15e-3, 0.16e-3, 'pairs'),
             StreamFit('force', 0.31, 0.092, 0.03, 0.031, 'pairs')),
        recalibrated={'E': Estimate(6.31e3, 6.18e3, 6.44e3)}, scene='corrected.yaml',
        evidence=198.3, held_out=212.7, chance=0.42, apart=14.2,
        notes=('Radius and ratio are known through their product only: they are strongly '
               'correlated.',
               'optical has 200 samples a second in all; they were averaged to 100.'))


def structural():
    found = Finding('encoder', 'pad_1', 'backlash', 'width', 0.31e-3, 'm', 0.012e-3, 13.2,
                    *SPAN, 'The marker on pad_1 departs from the encoder by 0.31 mm of play.',
                    parameters={'width': 0.31e-3, 'actuators': (0,)})
    return Diagnosis(
        'named', source('play', ('rich', 'fitted, kinds held out in turn')),
        causes=(Cause('backlash', {'width': Estimate(0.31e-3, 0.29e-3, 0.33e-3)},
                      {'actuators': (0,)}, 1.0),),
        where=(Place(actuator='pad_1', term='backlash'),),
        when=(Interval('rich', *SPAN, 'direction', term='backlash'),),
        fit=(StreamFit('optical', 0.33e-3, 0.24e-3, 0.15e-3, 0.152e-3,
                       'every kind of move in turn'),),
        scene='corrected.yaml', chance=0.61, apart=11.8, findings=(found,))


def equivalent():
    return Diagnosis(
        'equivalent', source('one_push', ('poor', 'fitted, kinds held out in turn')),
        causes=(Cause('actuator_gain', {'gain': Estimate(-0.055, -0.067, -0.043)},
                      {'actuators': (0,)}, 0.57, 1),
                Cause('actuator_compliance', {'compliance': Estimate(0.11e-3, 0.08e-3, 0.14e-3)},
                      {'actuators': (0,)}, 0.43, 2)),
        where=(Place(actuator='pad_1', term='actuator_gain', option=1),
               Place(actuator='pad_1', term='actuator_compliance', option=2)),
        when=(Interval('poor', 4.0, 40.0, 'amplitude'),),
        alternatives=(Alternative(('inclusion',), 1.9),
                      Alternative(('viscoelasticity',), 0.0, visible=False)),
        fit=(StreamFit('optical', 0.31e-3, 0.30e-3, 0.15e-3, 0.151e-3, 'the second cycle'),),
        next_experiment=NextExperiment(
            (Move('alone', 0.02, (PadTarget('pad_1', 8e-3),), hold=2.0, cycles=2),
             Move('against', 0.02, (PadTarget('pad_1', 8e-3), PadTarget('pad_3', 8e-3)),
                  hold=2.0, cycles=1)),
            record=('force',), splits=(('actuator_gain', 'actuator_compliance'),),
            separation=9.6),
        scene='corrected.yaml', chance=0.35, apart=0.4)


def nothing_missing():
    return Diagnosis(
        'nothing_missing', source('sound', ('rich', 'fitted'), ('pairs', 'held out')),
        alternatives=(Alternative(('stiffness_gradient',), 0.8), Alternative(('obstacle',), -0.4),
                      Alternative(('viscoelasticity',), -1.2)),
        fit=(StreamFit('optical', 0.153e-3, 0.151e-3, 0.15e-3, held_out='pairs'),
             StreamFit('em', 0.312e-3, 0.303e-3, 0.3e-3, held_out='pairs')),
        recalibrated={'E': Estimate(5.96e3, 5.84e3, 6.08e3)}, chance=0.38,
        limits=(Limit('backlash', 'width', 'mm', 0.0432, 0.14),
                Limit('inclusion', 'ratio', '1', 2.71, 0.85)))


def unexplained():
    return Diagnosis(
        'unexplained', source('stranger', ('rich', 'fitted, kinds held out in turn')),
        where=(Place(position=(-31e-3, 24e-3, 41e-3), radius=8.6e-3),
               Place(stream='optical', channel='tissue_10')),
        when=(Interval('rich', *TOUCH, 'unload', (23.31, 23.47)),),
        alternatives=(Alternative(('base_debond',), 81.0), Alternative(('inclusion',), 12.3),
                      Alternative(('obstacle',), 0.7)),
        nearest=Nearest(
            (Cause('base_debond', {
                'centre': Estimate((31e-3, -4e-3, 0.0), (29e-3, -6e-3, 0.0), (33e-3, -2e-3, 0.0)),
                'radius': Estimate(24.2e-3, 22.8e-3, 25.6e-3)}, probability=0.0),),
            (Place(boundary='base', position=(31e-3, -4e-3, 0.0), radius=2.9e-3,
                   term='base_debond'),),
            (StreamFit('optical', 0.44e-3, 0.39e-3, 0.15e-3, 0.21e-3, 'every kind in turn'),
             StreamFit('force', 0.046, 0.041, 0.03, 0.033, 'every kind in turn'))),
        fit=(StreamFit('optical', 0.44e-3, 0.39e-3, 0.15e-3, held_out='every kind in turn'),
             StreamFit('em', 0.33e-3, 0.31e-3, 0.3e-3, held_out='every kind in turn'),
             StreamFit('force', 0.046, 0.041, 0.03, held_out='every kind in turn')),
        next_experiment=NextExperiment(
            (Move('again', 2e-3, (PadTarget('pad_2', 5e-3),), hold=2.0, cycles=2),),
            instruction='Rest for 30 s before and after.'),
        chance=2e-7)


ANSWERS = {f.__name__: f for f in (named, structural, equivalent, nothing_missing, unexplained)}


@pytest.fixture(scope='session')
def answers():
    """Name -> Diagnosis: every verdict, and one that needs no tissue model."""
    return {name: make() for name, make in ANSWERS.items()}


@pytest.fixture(scope='session')
def shown():
    """The body, and a function from a Diagnosis to what is drawn beside it."""
    body = body_of(load_scene(SCENE), load_mesh(MESH))
    return lambda d: Shown(body, tuple(_traces(d)))


def _traces(d):
    t = np.linspace(*SPAN, 1240)
    for recording in d.provenance.recordings:
        for fit in d.fit:
            rng = stream(d.provenance.seed, f'{recording.name} {fit.stream}')
            noise = NOISE[fit.stream]
            quiet = noise * (1.0 + 0.12 * rng.standard_normal(len(t)))
            extra = np.zeros(len(t))
            for one in d.when:
                if one.recording == recording.name:
                    inside = (t >= one.t_start) & (t <= one.t_end)
                    extra += inside * 3.0 * fit.recalibrated * np.abs(np.sin(
                        np.pi * (t - one.t_start) / max(one.t_end - one.t_start, 1.0)))
            yield Trace(recording.name, fit.stream, t, np.hypot(quiet, extra), noise,
                        None if fit.named is None else quiet[::-1].copy())
