"""The live cell as the page hears it: frames one at a time, the newest first, none kept."""

import json
import threading

from arm_brachy.viewing.film import Film
from arm_brachy.viewing.page import view_page

LEAST_COLOUR = 10e-3    # m, of the legend; viewer.full_colour_mm of a scenario left as it is
KEPT_ALIVE = 5.0        # s, after which something is sent though nothing has changed
BUTTONS = (('hold', 'Hold'), ('home', 'Release and home'), ('stop', 'Emergency stop'))
AXES = 'xyz'
REACH = 10              # mm of a slider, to either side


class Feed:
    """The newest frame, and whoever waits for the next."""

    def __init__(self):
        self._changed, self._number, self._frame = threading.Condition(), 0, b''

    def put(self, frame):
        """Replace the newest frame; frame : JSON value."""
        text = b'data: ' + json.dumps(frame, separators=(',', ':')).encode() + b'\n\n'
        with self._changed:
            self._number, self._frame = self._number + 1, text
            self._changed.notify_all()

    def flow(self):
        """Yield frames as server-sent events, for ever; those overtaken are left out."""
        seen = 0
        while True:
            with self._changed:
                if self._number == seen:
                    self._changed.wait(KEPT_ALIVE)
                fresh, seen, text = self._number > seen, self._number, self._frame
            yield text if fresh else b': still here\n\n'


def frame(t, shapes, values):
    """A frame as JSON value: t [s], Shape each, values : curve -> line -> number.

    It stands alone: its layers and meshes are its own.
    """
    film = Film(LEAST_COLOUR)
    film.add(t, shapes)
    return json.loads(film.text(values=values))


def live_page(targets, token):
    """HTML of the page of a live cell.

    targets : that can be asked to go somewhere;  token : of the server
    """
    text = Film(LEAST_COLOUR).text(plots=[], pictures=False)
    end = f'openLive(DATA, {json.dumps(token)});'
    return view_page('live cell', 'layers called true are the simulated plant; a slider asks '
                     'mpc_manipulator for a goal, and the supervisor must allow it', text,
                     controls=_controls(targets), script_end=end)


def _controls(targets):
    options = ''.join(f'<option>{name}</option>' for name in targets)
    sliders = ''.join(
        f'<label>{axis} / mm<input type="range" class="goal" data-axis="{axis}" '
        f'min="-{REACH}" max="{REACH}" step="0.5" value="0"><output>0</output></label>'
        for axis in AXES)
    buttons = ''.join(f'<button type="button" data-do="{name}">{text}</button> '
                      for name, text in BUTTONS)
    return (f'<figure class="command"><figcaption>move a target from where it is, by the pads'
            f'</figcaption><label>target<select>{options}</select></label>{sliders}{buttons}'
            f'<p class="answer"></p></figure>')
