"""What `arm-brachy view` shows of a bag: the film of the run, its pictures, its curves."""

import io
import threading
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from arm_brachy import graph
from arm_brachy.core.errors import RecordingError
from arm_brachy.evaluation.replay import run_film
from arm_brachy.offline import load_run, recorded_cell, with_cell
from arm_brachy.recording.reader import CellBag
from arm_brachy.viewing.page import view_page
from arm_brachy.viewing.server import Answer

FRAMES = 1500           # of a film, at most: five minutes at the rate of the mesh
CURVE = 800             # samples of a curve, at most: what a screen is wide
PICTURES = (graph.ULTRASOUND_OVERLAY, graph.ULTRASOUND_IMAGE)   # the first that was recorded
MM = 1e3


def bag_pages(bag):
    """The pages of a recording, for `viewing.server.PageServer`.

    bag : path. Raises RecordingError if nothing of it can be drawn.
    """
    run = _run(bag)
    film = run_film(run, FRAMES)
    if not len(film):
        raise RecordingError(f'{bag}: holds nothing to draw: neither mesh nor markers, sensors or '
                             'pads; must be a recording of the cell or of an import')
    pictures = Pictures(bag)
    text = film.text(plots=plots(run), pictures=bool(len(pictures.t)))
    page = view_page(run.name, _about(bag, run), text).encode()
    return {'/': lambda query: Answer('text/html; charset=utf-8', page),
            '/picture': pictures.answer}


def _run(bag):
    with CellBag(bag) as reader:
        known = 'scenario.yaml' in reader.attachments()
    run = load_run(bag)
    if not known:
        return run
    with TemporaryDirectory() as scratch:
        return with_cell(run, recorded_cell(bag, scratch))


def _about(bag, run):
    tissue = '' if run.tissue is not None else 'no mesh was recorded, the body is not drawn; '
    true = ('layers called true are the simulated plant' if run.truth
            else 'all layers are measured or estimated')
    return f'{Path(bag)}: {tissue}{true}'


class Pictures:
    """The ultrasound pictures of a bag, each read when it is asked for."""

    def __init__(self, bag):
        """bag : path."""
        self._reader, self._lock = CellBag(bag), threading.Lock()
        held = self._reader.topics()
        names = [f'/{topic.name}' for topic in PICTURES if f'/{topic.name}' in held]
        self._topic = names[0] if names else None
        self._ns = np.array([r.log_time_ns for r in self._reader.records(names[:1])]
                            if names else [], dtype=np.int64)

    @property
    def t(self):
        """Times [s] of the pictures."""
        return self._ns * 1e-9

    def answer(self, query):
        """PNG of the newest picture not after ?t= [s], the first if there is none; None: none."""
        try:
            t = float(query['t'][0])
        except (KeyError, ValueError):
            return None
        if not len(self._ns):
            return None
        k = max(0, int(np.searchsorted(self.t, t + 1e-6, side='right')) - 1)
        when = int(self._ns[k])
        with self._lock:
            _, msg = next(self._reader.messages([self._topic], start_ns=when, stop_ns=when + 1))
        return Answer('image/png', png(msg))


def png(msg):
    """PNG of a sensor_msgs/Image, mono8 or rgb8."""
    shape = (msg.height, msg.width) if msg.encoding == 'mono8' else (msg.height, msg.width, 3)
    out = io.BytesIO()
    Image.fromarray(np.frombuffer(bytes(msg.data), np.uint8).reshape(shape)).save(
        out, 'PNG', compress_level=1)
    return out.getvalue()


def plots(run):
    """Curves of a RunData as JSON values: error of the targets, forces, travel of the pads."""
    found = [{'title': title, 'lines': [line for line in lines if line['t']]}
             for title, lines in (('error of the target / mm', _errors(run)),
                                  ('force of the tissue / N', _forces(run)),
                                  ('travel of the pads / mm', _travel(run)))]
    return [plot for plot in found if plot['lines']]


def line(name, t, y):
    """A curve of at most CURVE samples; NaN becomes a gap."""
    every = -(-len(t) // CURVE) or 1
    return {'name': name, 't': np.round(t[::every], 3).tolist(),
            'y': [round(float(v), 4) if np.isfinite(v) else None for v in y[::every]]}


def _errors(run):
    """Distance from the goal on the axes where it binds, task by task."""
    for task in run.tasks:
        series = run.truth.get(task.target)
        source = 'true'
        if series is None and task.target in run.em:
            series, source = run.em[task.target].tracked(), 'EM'
        if series is not None:
            part = series.between(task.t_start, task.t_end)
            error = np.linalg.norm((part.values - task.goal)[:, task.axes], axis=1)
            yield line(f'{task.name} ({source})', part.t, error * MM)


def _forces(run):
    if run.force is not None:
        names = run.force_pads or [pad.name for pad in run.pads]
        for k, name in enumerate(names):
            yield line(name, run.force.t, np.linalg.norm(run.force.values[:, k], axis=1))
    if run.procedure is not None and run.procedure.force is not None:
        yield line('probe', run.procedure.force.t, run.procedure.force.values)


def _travel(run):
    if run.encoder is not None:
        names = run.encoder_pads or [pad.name for pad in run.pads]
        for k, name in enumerate(names):
            yield line(name, run.encoder.t, run.encoder.values[:, k] * MM)
