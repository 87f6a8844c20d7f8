"""Where a result comes from: what ran, with which seed, from which commit, on what machine."""

from datetime import UTC, datetime

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation.result import commit_of, machine_description


def of(cell):
    """Metadata of a recording (str -> str): name, seed, commit, machine, start [UTC, ISO 8601]."""
    return {'name': cell.scenario.name, 'seed': str(cell.scenario.seed),
            'commit': commit_of(share_dir()), 'machine': str(machine_description()),
            'start': datetime.now(UTC).isoformat(timespec='seconds')}
