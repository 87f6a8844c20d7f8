"""Progress: counts that only grow, a clock that never stops, time left from finished work."""

import io
import re
import time

import pytest
from rich.console import Console

from arm_brachy.cli.progress import Clock, TimeIsOver, ended_after, minutes, shown
from arm_brachy.diagnosis.progress import FITS, SCREEN, SIGNALS, STEPS, UNITS, Count


class Watch:
    """Seconds that a test sets."""

    def __init__(self):
        self.t = 0.0

    def __call__(self):
        return self.t


@pytest.fixture
def watch():
    return Watch()


def test_the_clock_goes_on_while_nothing_is_reported(watch):
    clock = Clock(UNITS, watch)
    clock.report(SIGNALS, 1, 1)
    watch.t = 1565.0
    assert clock.line().startswith('26:05  step 1 of 6: signals')


def test_time_left_is_that_of_parts_as_long_as_those_that_are_finished(watch):
    clock = Clock(UNITS, watch)
    watch.t = 100.0
    clock.report(SCREEN, 0, 10, 'skin_layer')
    assert clock.left() is None and 'left' not in clock.line()
    watch.t = 104.0
    clock.report(SCREEN, 2, 10, 'gravity')
    assert clock.left() == pytest.approx(16.0)
    watch.t = 107.0
    assert clock.left() == pytest.approx(13.0)
    assert clock.line() == ('1:47  step 4 of 6: linear screen of candidate terms, 2 of 10 '
                            'candidates (gravity), about 0:13 left in this step')
    watch.t = 1000.0
    assert clock.left() == 0.0


def test_a_step_has_its_own_pace(watch):
    clock = Clock(UNITS, watch)
    clock.report(SCREEN, 0, 2)
    watch.t = 50.0
    clock.report(SCREEN, 2, 2)
    clock.report(FITS, 0, 5)
    assert clock.left() is None
    watch.t = 60.0
    clock.report(FITS, 1, 5)
    assert clock.left() == pytest.approx(40.0)


def test_fits_that_were_not_expected_are_counted_with_them():
    told = []
    count = Count(lambda *one: told.append(one), FITS, 1)
    for name in ('backlash', 'gravity'):
        count.begin(name)
        count.finish()
    count.expect(3)
    count.begin('inclusion')
    assert told == [(FITS, 0, 1, 'backlash'), (FITS, 1, 1, ''), (FITS, 1, 2, 'gravity'),
                    (FITS, 2, 2, ''), (FITS, 2, 5, 'inclusion')]


def test_a_log_has_a_line_for_every_step(watch):
    file = io.StringIO()
    with shown(Clock(UNITS, watch), Console(file=file, width=200)) as progress:
        for step in STEPS:
            for done in range(3):
                progress(step, done, 2)
    lines = file.getvalue().splitlines()
    assert [re.search('step (.) of 6: ([^,]*)', line).group(1) for line in lines] == list('123456')


def test_a_terminal_shows_the_time_while_nothing_is_reported():
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=200)
    with shown(Clock(UNITS), console) as progress:
        progress(FITS, 0, 3, 'backlash')
        time.sleep(2.5)
    assert {'0:00', '0:01', '0:02'} <= set(re.findall(r'\d:\d\d', file.getvalue()))


@pytest.mark.parametrize(('seconds', 'told'), [(7.9, '0:07'), (750.0, '12:30'),
                                              (3723.0, '1:02:03')])
def test_times(seconds, told):
    assert minutes(seconds) == told


def test_time_that_is_over_ends_the_work_and_only_that():
    with pytest.raises(TimeIsOver), ended_after(0.05):
        time.sleep(5.0)
    with ended_after(0.05):
        pass
    with ended_after(None):
        time.sleep(0.1)
