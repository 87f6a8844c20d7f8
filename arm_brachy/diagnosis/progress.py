"""How far a diagnosis is: named steps, parts of each that are done.

A diagnosis calls `progress(step, done, total, what)`: step one of STEPS, done parts of it (see
UNITS) that are finished, total how many there are as far as is known by now (it may grow), what is
worked on next. A step begins with done = 0.
Test: diagnosis/test_progress.py
"""

SIGNALS = 'signals, without a tissue model'
MESHES = 'mesh ensemble'
MODEL = 'model at the load states'
SCREEN = 'linear screen of candidate terms'
FITS = 'full fits of candidate terms'
ERRORS = 'held-out errors and next experiment'
STEPS = (SIGNALS, MESHES, MODEL, SCREEN, FITS, ERRORS)
FREE_STEPS = (SIGNALS, MODEL, SCREEN, FITS, ERRORS)     # of a body without pads
UNITS = {SIGNALS: 'recordings', MESHES: 'meshes', MODEL: 'recordings', SCREEN: 'candidates',
         FITS: 'fits', ERRORS: 'parts'}


def untold(step, done, total, what=''):
    """A progress function that tells nobody."""


class Count:
    """Parts of one step, counted as they finish.

    progress : as above;  step : one of STEPS;  total : parts expected
    """

    def __init__(self, progress, step, total):
        self._progress, self._step, self.done, self.total = progress, step, 0, total

    def expect(self, more):
        """Add parts to those expected."""
        self.total += more

    def begin(self, what=''):
        """Say what is worked on now; it counts among those expected."""
        self.total = max(self.total, self.done + 1)
        self._progress(self._step, self.done, self.total, what)

    def finish(self, what=''):
        """One more part is finished."""
        self.done += 1
        self.total = max(self.total, self.done)
        self._progress(self._step, self.done, self.total, what)
