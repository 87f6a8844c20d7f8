"""Curves: what is drawn is what was measured, and the misfit said is that of the curves."""

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.free_vibration.curves import FreePath, free_curves, free_traces
from arm_brachy.diagnosis.report.curves import Curve, curve_plate

T = np.linspace(0.0, 2.0, 81)


def path(after=True):
    """Two markers; the second is 0.4 mm off along z before, 0.1 mm after."""
    measured = np.zeros((len(T), 2, 3))
    measured[:, 1, 2] = 5e-3 * np.sin(T)
    before, found = measured.copy(), measured.copy()
    before[:, 1, 2] += 4e-4
    before[:, 0, 0] += 1e-4
    found[:, 1, 2] += 1e-4
    measured[3, 1] = np.nan
    return FreePath('let_go', 'optical', ('base', 'tip'), T, measured, before,
                    found if after else None, np.full((2, 3), 1e-5), 2e-5)


def test_the_channel_with_the_largest_misfit_comes_first():
    first, second = free_curves((path(),), 'damping')
    assert (first.channel, first.axis, second.channel, second.axis) == ('tip', 2, 'base', 0)
    assert first.misfit(first.before) == pytest.approx(4e-4)
    assert first.misfit(first.after) == pytest.approx(1e-4)


def test_the_figure_shows_measured_before_and_after_in_mm():
    axis, other = curve_plate(free_curves((path(),), 'damping')).figure.axes
    measured, before, after = axis.get_lines()
    assert np.nanmax(measured.get_ydata()) == pytest.approx(5.0, rel=1e-2)
    assert before.get_ydata()[0] == pytest.approx(0.4)
    assert after.get_label() == 'predicted, with damping'
    assert 'misfit 0.4 → 0.1 mm, noise 0.01 mm' in axis.get_title(loc='left')
    assert len(other.get_lines()) == 3


def test_where_nothing_was_named_there_is_no_curve_after():
    axis = curve_plate(free_curves((path(after=False),), '')).figure.axes[0]
    assert [line.get_label() for line in axis.get_lines()] == [
        'measured', 'predicted, recalibrated, no new term']


def test_residuals_over_time_are_over_channels_and_axes():
    trace, = free_traces((path(),))
    assert trace.recalibrated[0] == pytest.approx(np.sqrt((4e-4**2 + 1e-4**2) / 6))
    assert trace.named[0] == pytest.approx(1e-4 / np.sqrt(6)) and trace.floor == 2e-5


def test_a_curve_has_one_time_axis():
    with pytest.raises(InputError, match=r'before has shape \(3,\)'):
        Curve('run', 'optical', 'tip', 0, T, np.zeros(81), np.zeros(3), 1e-5)
