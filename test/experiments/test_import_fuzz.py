"""A handful of the damaged files of the study: none crashes, none is read as what it is not."""

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.guard import guarded
from arm_brachy.experiments import import_fuzz


def test_damaged_files_are_read_right_or_refused(tmp_path):
    result = import_fuzz.reproduce(tmp_path, mutants=70, seed=2)
    assert all(target.met for target in result.targets[:2]), result.rows
    rows = {row['kind']: row for row in result.rows}
    assert len(rows) == 7 and sum(row['bags'] for row in rows.values()) > 5


def test_the_second_reader_sees_a_value_that_was_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(import_fuzz, '_mutant', lambda data, rng: data)
    read = import_fuzz.import_csv

    def wrong(map_file, out):
        file = map_file.parent / 'plain.csv'
        sound = file.read_bytes()
        file.write_bytes(sound.replace(b'2.5,3', b'2.6,3', 1))
        read(map_file, out)
    monkeypatch.setattr(import_fuzz, 'import_csv', wrong)
    bases = import_fuzz._bases()
    outcome, _, changed = import_fuzz._try(tmp_path, 'plain table', *bases['plain table'], None)
    assert (outcome, changed) == ('bag', 1)


def test_a_reader_that_hangs_is_counted_though_its_guard_takes_any_oserror(tmp_path, monkeypatch):
    def hangs(map_file, out):
        with guarded(map_file, RecordingError, 'a readable file', 'mend it'):
            while True:
                pass
    monkeypatch.setattr(import_fuzz, 'import_csv', hangs)
    monkeypatch.setattr(import_fuzz, 'LIMIT', 0.1)
    bases = import_fuzz._bases()
    outcome, seconds, _ = import_fuzz._try(tmp_path, 'plain table', *bases['plain table'],
                                           np.random.default_rng(0))
    assert outcome.startswith('longer than')
    assert seconds > 0.05      # timers of the kernel are coarse
