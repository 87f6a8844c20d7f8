"""Progress of a long command: named steps with counts, elapsed time, time left of the step.

On a terminal one line that is drawn anew ten times a second; in a log or a pipe one line at each
step, and one at most every EVERY seconds within it.
"""

import signal
import threading
import time
from contextlib import contextmanager

from rich.markup import escape

from arm_brachy.cli.output import errors

EVERY = 30.0    # s between lines of a log within one step
BEAT = 0.1      # s between drawings on a terminal


class Clock:
    """Where a diagnosis is, and since when; what it says is what `line` returns.

    units : step -> what its parts are;  steps : names in their order, all in `units` until set
    now : function that tells seconds
    """

    def __init__(self, units, now=time.monotonic):
        self.steps, self._units, self._now = tuple(units), units, now
        self._start = now()
        self.step, self.what = None, ''
        self.done = self.total = 0
        self._begun = self._finished = self._start

    @property
    def elapsed(self):
        """[s] since the start."""
        return self._now() - self._start

    def report(self, step, done, total, what=''):
        """Take in what a diagnosis reports (`diagnosis.progress`); True if a step begins."""
        begins = step != self.step or done < self.done
        if begins:
            self.step, self._begun = step, self._now()
            self._finished = self._begun
        elif done > self.done:
            self._finished = self._now()
        self.done, self.total, self.what = done, total, what
        return begins

    def left(self):
        """[s] that the step still takes if each part takes as long as those that are finished.

        None while none is. A part that takes longer already than the mean adds nothing below zero.
        """
        if not self.done or not self.total:
            return None
        each = (self._finished - self._begun) / self.done
        return max((self.total - self.done) * each - (self._now() - self._finished), 0.0)

    def line(self):
        """The state in one line."""
        if self.step is None:
            return f'{minutes(self.elapsed)}  starting'
        where = f'step {self._number()} of {len(self.steps)}: {self.step}'
        count = f', {self.done} of {self.total} {self._units[self.step]}' if self.total else ''
        left = self.left()
        rest = '' if left is None or self.done >= self.total else (
            f', about {minutes(left)} left in this step')
        what = f' ({self.what.replace("_", " ")})' if self.what else ''
        return f'{minutes(self.elapsed)}  {where}{count}{what}{rest}'

    def _number(self):
        return self.steps.index(self.step) + 1


def minutes(seconds):
    """'0:07', '12:30', '1:02:03'."""
    whole = int(seconds)
    hours, rest = divmod(whole, 3600)
    parts = (hours, rest // 60, rest % 60) if hours else (rest // 60, rest % 60)
    return ':'.join([str(parts[0]), *(f'{part:02d}' for part in parts[1:])])


@contextmanager
def shown(clock, console=errors):
    """Context: a function for `diagnosis.progress` that shows a Clock on the console."""
    if console.is_terminal:
        with console.status(escape(clock.line())) as status, _beating(
                lambda: status.update(escape(clock.line())), BEAT):
            yield clock.report
        return

    def say():
        console.print(clock.line(), markup=False, highlight=False)

    def report(step, done, total, what=''):
        if clock.report(step, done, total, what):
            say()

    with _beating(say, EVERY):
        yield report


@contextmanager
def _beating(act, every):
    """Context in which `act` is called every so many seconds, by a thread of its own."""
    over = threading.Event()

    def run():
        while not over.wait(every):
            act()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


class TimeIsOver(KeyboardInterrupt):
    """The time that a person gave is over; it ends the work as Ctrl-C does."""


@contextmanager
def ended_after(seconds):
    """Context in which TimeIsOver is raised after so many seconds; None = never.

    For the main thread alone, as all signals are.
    """
    if seconds is None:
        yield
        return

    def end(*_):
        raise TimeIsOver

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
