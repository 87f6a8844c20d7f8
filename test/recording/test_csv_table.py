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
    ('t,x,x\n0,1,2\n', "column 'x' is there 2 times, as columns 2 and 3, with different"),
    ('t;x\n0;1\n', "one column only, by the delimiter ','; must be several: set `delimiter: "),
    ('t;x\n0;1,5\n', 'and `decimal: ","`'),
    ('t,x\n0,1,5\n1,1,25\n', 'commas before the decimals'),
    ('t,x,y\n0,1,2\n1,1\n2,1,2\n', '`incomplete: missing` if'),
    ('t,x,y\n0,1,2\n1,1\n', 'ends in the midst of its last row; set `incomplete: skip`'),
    ('frame,x\n1,0\n2,0\n', "no column 't'"),
    ('t,x\n0,1_0\n', "'1_0' is no number"),
    ('t,x\n0,\x1c10\n', 'is no number'),
    ('t,x\n1e30,1\n', 'a.csv:2:t: 1e+30 s is no time'),
    ('time,x\n0,1\n', "no column 't'"),
])
def test_refused_with_the_place(tmp_path, text, where):
    with pytest.raises(RecordingError) as caught:
        table(tmp_path, text).column('x')
    assert where in str(caught.value)
    assert '\n' not in str(caught.value)
    assert 'delete' not in str(caught.value)    # advice destroys no data


def test_unreadable_files(tmp_path):
    packed = tmp_path / 'a.csv.gz'
    packed.write_bytes(gzip.compress(b't,x\n0,1\n' * 100)[:-20])
    binary = tmp_path / 'b.csv'
    binary.write_bytes(b't,x\n\xff\xfe\x00,1\n')
    zero = tmp_path / 'zero.csv'
    zero.write_bytes(b't,x\n\x00,1\n')
    for path, words in ((packed, 'cannot be read'), (binary, 'b.csv:2: byte 0xff is no utf-8'),
                        (zero, 'zero byte'),
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
        table(tmp_path, 't;x\n0;1.234\n', **options).column('x')
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
    names, _ = table(tmp_path, 't,n,east\n0,1,2\n', frame_column='n').columns('{key}', {})
    assert names == ('east',)       # neither the times nor the counter
    with pytest.raises(RecordingError, match='no column has the form'):
        out.columns('q{key}_mm', {})
    with pytest.raises(RecordingError, match="no column 'c_X'"):
        out.columns('{key}_{axis}', {'mine': 'c'}, ('X', 'Y'))


def test_columns_that_nobody_asks_for_are_not_read(tmp_path):
    """A wall clock, a state in words, a name that repeats: every tracker's log has them."""
    text = 'stamp,t,x,note,note\n12:00:01,0,1,OK,\n12:00:02,1,2,lost,seen\n'
    np.testing.assert_array_equal(table(tmp_path, text).column('x'), [1, 2])


def test_a_delimiter_at_the_end_of_lines_makes_no_column(tmp_path):
    for text in ('t,x,\n0,1\n1,2\n', 't,x,\n0,1,\n1,2,\n', 't,x\n0,1,\n1,2,,\n'):
        np.testing.assert_array_equal(table(tmp_path, text).column('x'), [1, 2])


@pytest.mark.parametrize('text', ['nan', 'NaN', '-nan(ind)', '1.#QNAN', 'NA', '#N/A', 'NULL', ''])
def test_not_measured_as_programs_write_it(tmp_path, text):
    x = table(tmp_path, f't,x\n0,1\n1,{text}\n').column('x')
    np.testing.assert_array_equal(x, [1, np.nan])


def test_rows_that_end_early_on_request(tmp_path):
    text = 't,x,y\n0,1,2\n1,3\n2,5,6\n'
    out = table(tmp_path, text, incomplete='missing')
    np.testing.assert_array_equal(out.column('y'), [2, np.nan, 6])
    assert 'a.csv: 1 of 3 rows end early' in out.notes[0] and 'line 3' in out.notes[0]
    out = table(tmp_path, text, incomplete='skip')
    np.testing.assert_array_equal(out.column('x'), [1, 5])
    out = table(tmp_path, 't,x\n0,1\n,2\n2,3\n', incomplete='skip')
    np.testing.assert_array_equal(out.column('x'), [1, 3])
    assert 'have no time and were left out, the first in line 3' in out.notes[0]


def test_frame_numbers_are_times_by_their_rate_only(tmp_path):
    text = 'Frame,x\n1,0\n2,0\n4,0\n'
    with pytest.raises(RecordingError, match="'Frame' counts frames.*set `rate_Hz`"):
        table(tmp_path, text, time='Frame')
    out = table(tmp_path, text, time='Frame', rate=50.0)
    np.testing.assert_array_equal(out.t_ns, [20_000_000, 40_000_000, 80_000_000])
    out = table(tmp_path, text, time='', rate=50.0)
    np.testing.assert_array_equal(out.t_ns, [0, 20_000_000, 40_000_000])
    with pytest.raises(RecordingError, match='rows are counted; must have `rate_Hz`'):
        table(tmp_path, text, time='')
    out = table(tmp_path, 'n,x\n1,0\n2,0\n3,0\n', time='n')
    assert 'whole seconds, one by one; if they count samples, set `rate_Hz`' in out.notes[0]


def test_encodings(tmp_path):
    for encoding, given in (('utf-16', 'utf-8'), ('utf-8-sig', 'utf-8'), ('cp1252', 'cp1252')):
        (tmp_path / 'a.csv').write_bytes('t,Größe\r\n0,1\r\n'.encode(encoding))
        out = read_table(tmp_path / 'a.csv', replace(OPTIONS, encoding=given))
        assert out.column('Größe').tolist() == [1.0]
