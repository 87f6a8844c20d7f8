"""Tell the launcher how far things are: JSON lines on standard output, nothing else goes there."""

import json
import sys
import time


class Progress:
    """Writes `{"progress": {...}}` lines, at most one every `period_s` of wall time."""

    def __init__(self, period_s=0.5):
        self._period, self._last = period_s, 0.0

    def now(self, **values):
        """Write one line at once."""
        self._last = time.monotonic()
        sys.stdout.write(json.dumps({'progress': values}) + '\n')
        sys.stdout.flush()

    def sometimes(self, **values):
        """Write a line unless one was written less than a period ago."""
        if time.monotonic() - self._last >= self._period:
            self.now(**values)
