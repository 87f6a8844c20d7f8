"""A small run of the readers' fuzz: the figures of 2000 mutants each are in results/."""

import json
import subprocess
import sys


def test_no_damage_ends_in_a_traceback_or_in_other_values(tmp_path):
    command = [sys.executable, '-m', 'arm_brachy.experiments.reader_fuzz', '--seed', '2',
               '--mutants', '30', '--out', str(tmp_path / 'out.json')]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / 'out.json').read_text())
    assert {row['kind'] for row in found['rows']} >= {'STL', 'MSH', 'C3D', 'YAML', 'MCAP'}
    assert all(row['refused'] for row in found['rows']), done.stdout
    # checksums cover nearly all of a bag: of so few mutants none may be left that is sound
    assert all(row['read'] for row in found['rows'] if row['kind'] != 'MCAP'), done.stdout
    assert all(target['met'] for target in found['targets']), done.stdout
