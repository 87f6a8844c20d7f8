"""Tables: every mistake is named by file, line and column."""

import gzip
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording.csv_map import CsvFile
from arm_brachy.recording.csv_table import count_frames, read_table

OPTIONS = CsvFile('a.csv', time='t')


def table(tmp_path, text, **changes):
    path = tmp_path / 'a.csv'
    path.write_text(text)
    return read_table(path, replace(OPTIONS, **changes))


@pytest.mark.parametrize(('text', 'where'), [
    ('t,x\n0,1\n1,two\n', "a.csv:3:x: 'two'"),
    ('t,x\n0,1\n1,inf\n', "a.csv:3:x: 'inf'"),
    ('t,x\n0,1\n1,"0,5"\n', "a.csv:3:x: '0,5'"),
    ('t,x\n0,1\n1\n', 'a.csv:3: 1 cells'),
    ('t,x\n0,1\n1,2,3\n', 'a.csv:3: 3 cells'),
    ('t,x\n0,1\nnan,2\n', 'a.csv:3:t: no time'),
    ('t,x\n0,1\n\n2,1\n1,1\n', 'a.csv:5: earlier'),
    ('t,x\n0,1\n1,1\n1,2\n', 'a.csv:4: a second row'),
    ('t,x\n', 'holds no rows'),
    ('', 'a.csv:1: no header'),
    ('t,x,x\n0,1,2\n', "column 'x' appears twice"),
    ('time,x\n0,1\n', "no column 't'"),
])
def test_refused_with_the_place(tmp_path, text, where):
    with pytest.raises(RecordingError) as caught:
        table(tmp_path, text)
    assert where in str(caught.value)
    assert '\n' not in str(caught.value)


def test_unreadable_files(tmp_path):
    packed = tmp_path / 'a.csv.gz'
    packed.write_bytes(gzip.compress(b't,x\n0,1\n' * 100)[:-20])
    binary = tmp_path / 'b.csv'
    binary.write_bytes(b't,x\n\xff\xfe\x00,1\n')
    for path, words in ((packed, 'cannot be read'), (binary, 'cannot be read'),
                        (tmp_path / 'none.csv', 'no such file')):
        with pytest.raises(RecordingError, match=words):
            read_table(path, OPTIONS)


def test_missing_values_and_other_words(tmp_path):
    text = 't,x\n0,NaN\n1,\n2,lost\n3,-9999\n4,5\n'
    x = table(tmp_path, text, missing=('lost', '-9999')).column('x')
    np.testing.assert_array_equal(np.isnan(x), [True, True, True, True, False])


def test_times_units_offset_and_lines(tmp_path):
    text = '# made by hand\nt;x\n1000;1\n1010;2\n'
    out = table(tmp_path, text, time_unit='ms', clock_offset=0.002, delimiter=';', header_line=2)
    np.testing.assert_array_equal(out.t_ns, [1_002_000_000, 1_012_000_000])
    np.testing.assert_array_equal(out.lines, [3, 4])


def test_a_line_of_units_below_the_names_is_skipped(tmp_path):
    text = 't,x\ns,mm\n0,1\n1,2\n'
    out = table(tmp_path, text, skip_below=1)
    np.testing.assert_array_equal(out.column('x'), [1, 2])
    np.testing.assert_array_equal(out.lines, [3, 4])
    with pytest.raises(RecordingError, match=r"a.csv:2:t: 's' is no number.*skip_below: 1"):
        table(tmp_path, text)


def test_where_decimals_follow_a_comma_a_point_is_no_decimal(tmp_path):
    """A thousand in such places; words for what is missing are compared as the file has them."""
    options = {'delimiter': ';', 'decimal': ',', 'missing': ('-9999,0',)}
    with pytest.raises(RecordingError, match=r"a.csv:2:x: '1\.234'"):
        table(tmp_path, 't;x\n0;1.234\n', **options)
    x = table(tmp_path, 't;x\n0;-9999,0\n1;1,5\n', **options).column('x')
    np.testing.assert_array_equal(x, [np.nan, 1.5])


def test_decimals_may_follow_a_comma(tmp_path):
    out = table(tmp_path, 't;x\n0,5;-1,25\n1;2e-1\n', delimiter=';', decimal=',')
    np.testing.assert_array_equal(out.column('x'), [-1.25, 0.2])
    np.testing.assert_array_equal(out.t_ns, [500_000_000, 1_000_000_000])


def test_unsorted_and_duplicates_on_request(tmp_path):
    text = 't,x\n2,20\n0,0\n1,10\n1,11\n'
    out = table(tmp_path, text, unsorted='sort', duplicates='first')
    np.testing.assert_array_equal(out.column('x'), [0, 10, 20])
    out = table(tmp_path, text, unsorted='sort', duplicates='last')
    np.testing.assert_array_equal(out.column('x'), [0, 11, 20])
    with pytest.raises(RecordingError, match='a.csv:5: a second row'):
        table(tmp_path, text, unsorted='sort')


def test_frame_counter(tmp_path):
    out = table(tmp_path, 't,n\n0,7\n1,8\n2,11\n', frame_column='n')
    np.testing.assert_array_equal(out.frames, [7, 8, 11])
    with pytest.raises(RecordingError, match=r'a.csv:3:n: no frame counter'):
        table(tmp_path, 't,n\n0,7\n1,8.5\n', frame_column='n')
    jittered = np.array([0, 11, 19, 52, 60]) * 10**6  # 10 ms apart, two lost
    np.testing.assert_array_equal(count_frames(jittered), [0, 1, 2, 5, 6])


def test_columns_by_pattern(tmp_path):
    out = table(tmp_path, 't,b_1_X,b_1_Y,a_X,a_Y,other\n0,1,2,3,4,5\n')
    names, cells = out.columns('{key}_{axis}', {}, ('X', 'Y'))
    assert names == ('b_1', 'a')
    np.testing.assert_array_equal(cells, [[[1, 2], [3, 4]]])
    names, cells = out.columns('{key}_{axis}', {'mine': 'a'}, ('X', 'Y'))
    assert (names, cells.tolist()) == (('mine',), [[[3.0, 4.0]]])
    with pytest.raises(RecordingError, match='no column has the form'):
        out.columns('q{key}_mm', {})
    with pytest.raises(RecordingError, match="no column 'c_X'"):
        out.columns('{key}_{axis}', {'mine': 'c'}, ('X', 'Y'))
