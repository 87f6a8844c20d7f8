"""Faults of `arm-brachy abuse`: their order, what counts as a violation, and going on."""

import pytest

from arm_brachy.control.faults import OF_THE_NEEDLE, Bounds, Kind, draw
from arm_brachy.control.procedure_params import ProcedureParams
from arm_brachy.core.errors import InputError
from arm_brachy.devices.insertion import InsertionProfile
from arm_brachy.experiments import abuse
from arm_brachy.scenario import Limits, Scenario

SOUND = {'overshoot_mm': 0.0, 'rest_s': 0.3, 'held_s': 0.0, 'obeyed': 0, 'violated': False,
         'recovered': True}


def test_every_kind_comes_in_turn_and_the_seed_says_in_which_order():
    n = len(Kind)
    faults = draw(3 * n, 1)
    assert all(sum(f.kind is kind for f in faults) == 3 for kind in Kind)
    assert faults == draw(3 * n, 1) != draw(3 * n, 2)
    assert faults[:5] == draw(5, 1)


@pytest.mark.parametrize(('wrong', 'missed'), [
    ({'overshoot_mm': 0.2}, 'way of a pad'), ({'rest_s': 1.1}, 'until all rests'),
    ({'obeyed': 1}, 'forged commands'), ({'recovered': False}, 'did not run again')])
def test_a_fault_that_does_something_is_a_violation(wrong, missed):
    row = {'kind': 'FORGED', **SOUND, 'violated': True, **wrong}
    targets = {t.name: t.met for t in abuse._fault_targets([row], 1)}
    assert [name for name, met in targets.items() if not met and missed in name]
    assert all(t.met for t in abuse._fault_targets([{'kind': 'FORGED', **SOUND}], 1))


@pytest.fixture
def benches(monkeypatch):
    """Stands for both benches; (name, faults done before) of each run, and a limit of faults."""
    ran, most = [], [1000]

    def run(name, scenario, n, seed, done, log, say):
        ran.append((name, done))
        kinds = abuse.BENCHES[name][1]
        mine = [(k, f) for k, f in enumerate(draw(n, seed)) if f.kind in kinds]
        for k, fault in mine[done:done + most[0]]:
            log.keep(f'fault {k}', {'number': k, 'kind': fault.kind.name, **SOUND})
        if len(mine) > done + most[0]:
            raise KeyboardInterrupt
    monkeypatch.setattr(abuse, '_bench', run)
    return ran, most


def test_a_campaign_goes_on_where_it_was_ended(benches, tmp_path):
    ran, most = benches
    most[0] = 7
    with pytest.raises(KeyboardInterrupt):
        abuse.reproduce(tmp_path, faults=30, cells=0, files=0, seed=3)
    most[0] = 1000
    result = abuse.reproduce(tmp_path, faults=30, cells=0, files=0, seed=3)
    assert ran == [('abuse_bench', 0), ('abuse_bench', 7), ('abuse_probe_bench', 0)]
    assert sum(row['faults'] for row in result.rows) == 30 and result.met
    assert abuse.reproduce(tmp_path, faults=30, cells=0, files=0, seed=3).rows == result.rows
    assert len(ran) == 3
    abuse.reproduce(tmp_path, faults=60, cells=0, files=0, seed=3)
    needle = sum(f.kind in OF_THE_NEEDLE for f in draw(30, 3))
    assert ran[3:] == [('abuse_bench', 30 - needle), ('abuse_probe_bench', needle)]


def test_a_campaign_of_another_seed_is_not_mixed_in(benches, tmp_path):
    abuse.reproduce(tmp_path, faults=5, cells=0, files=0, seed=3)
    with pytest.raises(InputError, match='holds a campaign of seed 3; got 4'):
        abuse.reproduce(tmp_path, faults=5, cells=0, files=0, seed=4)


def test_a_dead_supervisor_is_noticed_in_time_to_rest():
    """Silence, a tick to hear of it, a tick to act, and the braking of a needle that withdraws."""
    fastest, tick = (kind.__dataclass_fields__[name].default
                     for kind, name in ((ProcedureParams, 'withdrawal'), (Scenario, 'tick')))
    needed = Limits().silence + 2.0 * tick + fastest / InsertionProfile().braking
    assert needed <= Bounds().rest + 1e-9
