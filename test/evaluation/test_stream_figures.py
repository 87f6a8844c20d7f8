"""The look at an import shows every stream and what is missing of it."""

import numpy as np

from arm_brachy.evaluation.stream_figures import streams_plate
from arm_brachy.evaluation.stream_report import write_stream_report
from arm_brachy.evaluation.timeseries import EmSamples, OpticalFrames, RunData, Series


def a_run():
    t = np.arange(200) / 100.0
    gap = slice(50, 70)
    points = np.zeros((200, 2, 3))
    points[:, 0, 0] = 0.01 * np.sin(t)
    visible = np.ones((200, 2), dtype=bool)
    visible[gap, 1] = False
    encoder = np.column_stack([0.01 * t, 0.0 * t])
    lost = np.r_[0:100, 150:200]
    status = np.zeros(200, dtype=int)
    status[gap] = 1
    return RunData('a', '', 0, '', '', encoder=Series(t[lost], encoder[lost]),
                   encoder_pads=('east', 'west'),
                   optical=OpticalFrames(t, ('m1', 'm2'), points, visible),
                   em={'lump': EmSamples(t, points[:, 0], np.zeros(200), status)},
                   force=Series(t, np.ones((200, 1, 3))), force_pads=('east',))


def test_every_stream_has_a_panel_that_tells_its_gaps(tmp_path):
    plate = streams_plate(a_run())
    titles = [axis.get_title(loc='left') for axis in plate.figure.axes]
    assert titles == ['Encoders: 100 Hz, 0 missing values, rows lost at 1 places',
                      'Optical markers: 100 Hz, 20 missing values',
                      'EM tools: 100 Hz, 20 missing values', 'Forces: 100 Hz, 0 missing values']
    marks = [line for line in plate.figure.axes[1].lines if line.get_marker() == '|']
    assert sum(len(line.get_xdata()) for line in marks) == 20
    travel = plate.figure.axes[0].lines[0]
    assert np.isnan(travel.get_ydata()[100])    # no line across lost rows
    np.testing.assert_allclose(np.nanmax(travel.get_ydata()), 19.9)     # mm
    moved = plate.figure.axes[1].lines[0].get_ydata()
    np.testing.assert_allclose(np.nanmax(moved), 10.0 * np.sin(np.pi / 2), rtol=0.1)
    plate.save(tmp_path / 'a.png')
    assert (tmp_path / 'a.png').stat().st_size > 1e4


def test_a_recording_without_streams_has_no_picture():
    assert streams_plate(RunData('a', '', 0, '', '')) is None


def test_the_page_has_a_row_for_every_stream(tmp_path):
    result, page = write_stream_report(a_run(), tmp_path / 'page.html')
    assert [(row['stream'], row['missing_values'], row['of']) for row in result.rows] == [
        ('Encoders', 0, 'travel in mm'), ('Optical markers', 20, 'moved in mm'),
        ('EM tools', 20, 'moved in mm'), ('Forces', 0, 'size in N')]
    assert 'data:image/svg+xml' in page.read_text()
