"""From a bag to numbers, without ROS: run data, the model's predictions, the reports."""

from collections import Counter, defaultdict
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy import cell as cells
from arm_brachy import graph
from arm_brachy import offline_procedure as procedure
from arm_brachy.control.move_events import Event, Status
from arm_brachy.core.errors import CommandRefused, ConfigError, RecordingError
from arm_brachy.core.outcome import Outcome
from arm_brachy.evaluation.moves import move_windows
from arm_brachy.evaluation.timeseries import (
    EmSamples,
    NodeOutcome,
    OpticalFrames,
    PadMark,
    RunData,
    Series,
    TargetEstimates,
    TaskWindow,
    Tissue,
    TopicRecord,
)
from arm_brachy.recording.reader import CellBag, stamp_ns
from arm_brachy.recording.writer import PROVENANCE
from arm_brachy.scenario import load_cell, unbundle

ENDED = (Status.IDLE, Status.HOMING, Status.DONE, Status.FINISHED)


class _Tally:
    """Collects what one pass over a bag finds, topic by topic."""

    def __init__(self):
        self.series = defaultdict(lambda: ([], []))
        self.stamps, self.published = defaultdict(list), Counter()
        self.tasks, self.outcomes, self.last_outcome = [], Counter(), {}
        self.departures = []
        self.topology = None
        self.pads = self.points = self.actuators = ()
        self.ids = ()
        self.steps, self.periods, self.frames, self.shafts = [], [], [], {}

    def add(self, name, t, value):
        """Append one sample of a named signal."""
        times, values = self.series[name]
        times.append(t)
        values.append(value)

    def get(self, name):
        """The signal as Series, or None if it never came."""
        if name not in self.series:
            return None
        times, values = self.series[name]
        width = {len(value) for value in values if np.ndim(value) == 1}
        if len(width) > 1:      # actuators that were first named later on
            values = [np.pad(value, (0, max(width) - len(value)), constant_values=np.nan)
                      for value in values]
        return Series(np.array(times), np.array(values))


def _vectors(flat):
    return np.asarray(flat, dtype=float).reshape(-1, 3)


def _xyz(p):
    return np.array([p.x, p.y, p.z])


def _on_encoder(tally, topic, t, msg):
    """Some actuators may be missing in a message: the import leaves out what was not read."""
    names = tuple(msg.name)
    if not names or (len(names) == len(msg.position) and set(names) == set(tally.actuators)):
        tally.add('encoder', t, _by_actuator(tally, topic, names, msg.position))
        return
    if len(set(names)) != len(names) or len(names) != len(msg.position):
        raise RecordingError(f'{topic}: {", ".join(names)} with {len(msg.position)} positions; '
                             'must name each actuator once, with one position each')
    tally.actuators = tuple(dict.fromkeys((*tally.actuators, *names)))
    given = dict(zip(names, msg.position, strict=True))
    tally.add('encoder', t, np.array([given.get(name, np.nan) for name in tally.actuators]))


def _by_actuator(tally, topic, names, position):
    """Positions (p,) [m] in the order in which the recording names the actuators first."""
    tally.actuators = tally.actuators or tuple(names)
    try:
        return cells.in_driver_order(names, position, tally.actuators)
    except CommandRefused as error:
        raise RecordingError(f'{topic}: {error}') from None


def _on_command(tally, topic, t, msg):
    if len(msg.position):
        # What does not name the actuators the driver has refused: it led nowhere.
        with suppress(CommandRefused):
            tally.add('command', t, cells.in_driver_order(
                msg.names, msg.position, tally.actuators or msg.names))


def _on_pose(tally, topic, t, msg):
    tally.add(('pose', topic.split('/')[-2]), t, _xyz(msg.pose.position))


def _on_status(tally, topic, t, msg):
    tally.add(('status', topic.split('/')[-2]), t, (msg.status, msg.quality))


def _on_estimate(tally, topic, t, msg):
    name, target = topic.split('/')[-2:]
    covariance = np.reshape(msg.pose.covariance, (6, 6))[:3, :3]
    tally.add(('estimate', name, target), t, np.vstack([_xyz(msg.pose.pose.position),
                                                        covariance]))


def _on_optical(tally, topic, t, msg):
    tally.ids = tuple(msg.ids)
    tally.add('optical', t, np.array([_xyz(p) for p in msg.points]).reshape(-1, 3))
    tally.add('visible', t, np.array(msg.visible, dtype=bool))


def _on_wrench(tally, topic, t, msg):
    tally.add(('force', topic.split('/')[-2]), t, _xyz(msg.wrench.force))


def _on_truth_pads(tally, topic, t, msg):
    tally.add('pads', t, _by_actuator(tally, topic, msg.names, msg.position))


def _on_points(tally, topic, t, msg):
    side = topic.split('/')[-2]
    tally.points, tally.pads = tuple(msg.names), tuple(msg.pads)
    tally.add((side, 'points'), t, _vectors(msg.positions))
    tally.add((side, 'force'), t, _vectors(msg.pad_force))


def _on_topology(tally, topic, t, msg):
    tally.topology = (_vectors(msg.rest_positions), np.asarray(msg.tetrahedra).reshape(-1, 4))


def _on_positions(tally, topic, t, msg):
    tally.add('mesh', t, _vectors(msg.positions))


def _on_task(tally, topic, t, msg):
    tally.tasks.append((t, msg))


def _on_outcome(tally, topic, t, msg):
    key = (msg.source, msg.outcome)
    tally.outcomes[key] += 1
    tally.last_outcome[key] = msg.advice
    if msg.source == graph.MISMATCH_MONITOR.name and msg.outcome == Outcome.DEPARTED.name:
        tally.departures.append((t, msg.advice))


def _on_done(tally, topic, t, msg):
    for name, count in zip(msg.topics, msg.counts, strict=True):
        tally.published[msg.node, name] = max(tally.published[msg.node, name], count)


HANDLERS = (
    (graph.ACTUATORS, _on_encoder), (graph.COMMAND, _on_command), (graph.EM_POSE, _on_pose),
    (graph.EM_STATUS, _on_status), *((topic, _on_estimate) for topic in graph.ESTIMATES),
    (graph.OPTICAL, _on_optical), (graph.WRENCH, _on_wrench),
    (graph.TRUTH_PADS, _on_truth_pads), (graph.TRUTH_POINTS, _on_points),
    (graph.MODEL_POINTS, _on_points), (graph.TRUTH_TOPOLOGY, _on_topology),
    (graph.TRUTH_POSITIONS, _on_positions), (graph.TASK, _on_task),
    (graph.OUTCOME, _on_outcome), *procedure.HANDLERS)
MEASURED = (graph.ACTUATORS, graph.COMMAND, graph.EM_POSE, graph.EM_STATUS, graph.OPTICAL,
            graph.WRENCH)


def _handler(name):
    return next((h for topic, h in HANDLERS if topic.matches(name.lstrip('/'))), None)


def _tally(bag, topics=None):
    """One pass over an open CellBag; of the answers to ticks only the last are decoded.

    topics : of graph.Topic, None = all
    """
    tally, last_done = _Tally(), {}
    names = {n for n in bag.topics()
             if topics is None or any(topic.matches(n.lstrip('/')) for topic in topics)}
    done = {n for n in names if graph.TICK_DONE.matches(n.lstrip('/'))}
    for record in bag.records(sorted(done)) if done else ():
        tally.stamps[record.topic].append(record.log_time_ns * 1e-9)
        last_done[record.topic] = record.log_time_ns
    for name, when in last_done.items():
        for _, msg in bag.messages([name], start_ns=when):
            _on_done(tally, name, when, msg)
    unread = {n for n in names if any(topic.matches(n.lstrip('/')) for topic in procedure.UNREAD)}
    for record in bag.records(sorted(unread)) if unread else ():
        tally.stamps[record.topic].append(record.log_time_ns * 1e-9)
    rest = sorted(names - done - unread)
    for record, msg in bag.messages(rest) if rest else ():
        t = (stamp_ns(msg) if hasattr(msg, 'header') else record.log_time_ns) * 1e-9
        tally.stamps[record.topic].append(t)
        handle = _handler(record.topic)
        if handle is not None:
            handle(tally, record.topic, t, msg)
    return tally


def recorded_cell(bag, folder):
    """The cell that a bag was recorded from, unpacked into `folder`.

    bag : path.  Raises ConfigError if the bag holds no scenario (an import, for instance).
    """
    with CellBag(bag) as reader:
        files = reader.attachments()
    try:
        return load_cell(unbundle(files, folder))
    except ConfigError as error:
        raise ConfigError(f'{bag}: {error}') from None


def load_run(bag, *, measured=False):
    """Read a bag (path) as evaluation.timeseries.RunData. Raises RecordingError.

    measured : read what a real cell would have published and leave the rest on the disk: meshes of
        a simulated recording take a hundred times the memory of its sensors
    """
    with CellBag(bag) as reader:
        tally = _tally(reader, MEASURED if measured else None)
        origin = reader.metadata().get(PROVENANCE, {})
        kinds = {name: topic.type for name, topic in reader.topics().items()}
        files, left_out = reader.attachments(), reader.left_out
    force_pads, force = _forces(tally)
    return RunData(
        name=origin.get('name', str(bag)), scenario=files.get('scenario.yaml', b'').decode(),
        seed=int(origin.get('seed', 0)), commit=origin.get('commit', 'unknown'),
        machine=origin.get('machine', 'unknown'), recorded_at=origin.get('start', ''),
        left_out=left_out,
        tasks=_windows(tally), moves=_moves(tally), truth=_truth(tally), em=_em(tally),
        estimates=_estimates(tally),
        encoder=tally.get('encoder'), command_position=tally.get('command'),
        pad_displacement=tally.get('pads'), encoder_pads=tally.actuators, force=force,
        force_pads=force_pads, optical=_optical(tally),
        tissue=_tissue(tally), topics=_topics(tally, kinds), outcomes=_outcomes(tally),
        departures=tuple(tally.departures),
        procedure=procedure.procedure_of(tally.get, tally.steps, tally.periods, tally.frames,
                               tally.shafts))


def _windows(tally):
    windows, start = [], None
    for t, msg in tally.tasks:
        if start is not None and msg.state in ENDED:
            windows.append(_window(start, t, msg))
            start = None
        if msg.state == Status.ACTIVE and msg.target:  # a prescribed move has none
            start = (t, msg)
    return tuple(windows)


def _window(start, t_end, end):
    """The goal is that of the end: a procedure corrects it while the pads are on their way."""
    t, msg = start
    last = end if end.state == Status.DONE and end.name == msg.name else msg
    return TaskWindow(msg.name, msg.target, t, t_end, _xyz(msg.start), _xyz(last.goal),
                      np.array(msg.axes, dtype=bool))


def _moves(tally):
    return move_windows([Event(t, msg.state, msg.index, msg.name, msg.message)
                         for t, msg in tally.tasks if not msg.target])


def _truth(tally):
    points = tally.get(('truth', 'points'))
    if points is None:
        return {}
    return {name: Series(points.t, points.values[:, i]) for i, name in enumerate(tally.points)}


def _em(tally):
    out = {}
    for kind, tool in [k for k in tally.series if isinstance(k, tuple) and k[0] == 'status']:
        status, pose = tally.get((kind, tool)), tally.get(('pose', tool))
        position = np.full((len(status), 3), np.nan)
        if pose is not None:
            where = np.searchsorted(status.t, pose.t)
            position[where] = pose.values
        out[tool] = EmSamples(status.t, position, status.values[:, 1],
                              status.values[:, 0].astype(int))
    return out


def _estimates(tally):
    out = {}
    for _, name, target in [k for k in tally.series if k[0] == 'estimate']:
        said = tally.get(('estimate', name, target))
        out.setdefault(name, {})[target] = TargetEstimates(said.t, said.values[:, 0],
                                                           said.values[:, 1:])
    return out


def _forces(tally):
    """Names of the pads and their forces on one time axis, NaN where a pad's is missing."""
    keys = sorted(k for k in tally.series if isinstance(k, tuple) and k[0] == 'force')
    if not keys:
        return (), None
    series = [tally.get(k) for k in keys]
    t = np.unique(np.concatenate([s.t for s in series]))
    values = np.full((len(t), len(series), 3), np.nan)
    for i, one in enumerate(series):
        values[np.searchsorted(t, one.t), i] = one.values
    return tuple(name for _, name in keys), Series(t, values)


def _optical(tally):
    points = tally.get('optical')
    if points is None:
        return None
    return OpticalFrames(points.t, tally.ids, points.values, tally.get('visible').values)


def _tissue(tally):
    mesh = tally.get('mesh')
    if mesh is None or tally.topology is None:
        return None
    return Tissue(mesh.t, mesh.values, *tally.topology)


def _topics(tally, kinds):
    published = Counter()
    for (_, name), count in tally.published.items():
        published['/' + name.lstrip('/')] += count
    for topic in procedure.DECIMATED:   # the recorder keeps some of them: no loss can be told
        published.pop('/' + topic.name, None)
    for name in published:  # of a run that died, messages outlive the last count of their sender
        published[name] = max(published[name], len(tally.stamps.get(name, ())))
    return tuple(TopicRecord(name, kinds[name], np.sort(np.array(tally.stamps[name])),
                             published.get(name)) for name in sorted(tally.stamps))


def _outcomes(tally):
    return tuple(NodeOutcome(node, outcome, n, tally.last_outcome[node, outcome])
                 for (node, outcome), n in sorted(tally.outcomes.items()))


def with_scene(run, scene):
    """Add to RunData what only the scene knows: where pads and markers sit, the pads' order.

    Of the true points only the targets are kept. Raises RecordingError if actuators and pads have
    different names.
    """
    directions = cells.pad_directions(scene)
    pads = tuple(PadMark(p.name, np.array(p.centre), d, p.radius)
                 for p, d in zip(scene.pads, directions, strict=True))
    order = [p.name for p in pads if p.name in run.force_pads]
    force = run.force
    if run.force_pads:
        index = [run.force_pads.index(name) for name in order]
        force = Series(force.t, force.values[:, index])
    targets = {target.name for target in scene.targets}
    return replace(run, pads=pads, force=force, force_pads=tuple(order),
                   truth={name: s for name, s in run.truth.items() if name in targets},
                   markers={m.name: np.array(m.position) for m in scene.markers},
                   **_in_scene_order(run, scene))


def _in_scene_order(run, scene):
    """Fields of RunData with a column per actuator, in the order of the scene's pads."""
    wanted, given = tuple(p.name for p in scene.pads), run.encoder_pads
    if not wanted or not given:
        return {}
    if sorted(wanted) != sorted(given):
        raise RecordingError(f'the recording has actuators {", ".join(given)}; scene {scene.name} '
                             f'has {", ".join(wanted)}; give the scene it was made with, and the '
                             'travel of pads that stand still too, zeros')
    index = [given.index(name) for name in wanted]
    series = {name: getattr(run, name)
              for name in ('encoder', 'command_position', 'pad_displacement')}
    return {'encoder_pads': wanted, **{name: Series(s.t, s.values[:, index])
                                       for name, s in series.items() if s is not None}}


def with_cell(run, cell):
    """`with_scene`, and what only the scenario knows: which loop was closed, what was planned.

    run : RunData of a bag;  cell : scenario.Cell that it was recorded from
    """
    scenario, mode = cell.scenario, f'{cell.scenario.control.loop}_loop'
    return replace(with_scene(run, cell.scene), feedback=scenario.feedback,
                   tasks_planned=tasks_planned(scenario),
                   procedure=procedure.with_instruments(run.procedure, cell),
                   moves_planned=len(scenario.moves) or None,
                   tasks=tuple(replace(window, mode=mode) for window in run.tasks))


def tasks_planned(scenario):
    """Goals that are set in a run of a Scenario; None where there are none."""
    return len(scenario.tasks) or (None if scenario.procedure is None else 1)


def ticks(cell, t_end, t_start=0.0):
    """Times (n,) [s] at which a replay of a recording from t_start to t_end [s] asks the model."""
    first = max(1, round(t_start * 1e9) // cell.tick_ns)
    last = -(-round(t_end * 1e9) // cell.tick_ns)
    return np.arange(first, last + 1) * cell.tick_ns * 1e-9


@dataclass(frozen=True)
class Prediction:
    """What a model says of a recording.

    t : (n,) [s];  names : k markers and targets;  points : (n, k, 3) [m]
    pads : p names;  force : (n, p, 3) [N] of the tissue on each pad
    tissue : Tissue, the body at the scenario's mesh rate
    failed : steps that the model could not solve and held its last good state instead; None where
        that is not known
    """

    t: np.ndarray
    names: tuple
    points: np.ndarray
    pads: tuple
    force: np.ndarray
    tissue: Tissue | None = None
    failed: int | None = None


def predict(cell, t_end, encoder=None, *, t_start=0.0):
    """What the model says at every tick that brings news, from t_start to t_end [s].

    cell : scenario.Cell
    t_start : first time of the recording, a date perhaps; a body with pads waits for `encoder`
    encoder : Series of (n, p) [m] with the times of its samples; None for a body without pads
    Returns Prediction. The node tissue_model, replayed, computes the same, bit for bit.
    Raises RecordingError if the numbers of actuators differ.
    """
    body = cells.build_tissue(cell, 'model')
    p = len(body.pad_names)
    if p and encoder is None:
        raise RecordingError(f'scene {cell.scene.name} has {p} pads and the recording no '
                             'actuators/state; give a scene without pads or import the encoders')
    if p and encoder.values.shape[1] != p:
        raise RecordingError(f'the recording has {encoder.values.shape[1]} actuators, scene '
                             f'{cell.scene.name} {p} pads; give the scene it was made with')
    begin = max(t_start, encoder.t[0]) if p else t_start
    readings = list(_readings(body, ticks(cell, t_end, begin), encoder if p else None))
    if not readings:
        raise RecordingError(f'the recording ends at {t_end:g} s, before the model was asked '
                             f'once; tick_ms is {cell.tick_ns * 1e-6:g}')
    shown = _at_mesh_rate(readings, cell.scenario.mesh_rate)
    tissue = Tissue(np.array([r.t for r in shown]), np.stack([r.x for r in shown]),
                    body.mesh.nodes, body.mesh.tets)
    return Prediction(np.array([r.t for r in readings]), body.point_names,
                      np.stack([r.points for r in readings]), body.pad_names,
                      np.stack([r.pad_force for r in readings]), tissue,
                      sum(not r.outcome.ok for r in readings))


def _at_mesh_rate(readings, rate):
    """The first reading of every period of the mesh topic, as the tissue node publishes them."""
    period_ns = round(1e9 / rate)
    periods = [round(r.t * 1e9) // period_ns for r in readings]
    return [r for i, r in enumerate(readings) if i == 0 or periods[i] > periods[i - 1]]


def _readings(body, times, encoder):
    before = -np.inf
    for t in times:
        if encoder is None:
            yield body.step(t, np.zeros(0))
            continue
        due = np.flatnonzero((encoder.t > before) & (encoder.t <= t))
        before = t
        if len(due):
            yield body.step(encoder.t[due[-1]], encoder.values[due[-1]])


def recorded_prediction(bag):
    """What a model said while the bag (path) was recorded, as Prediction; None if none ran."""
    wanted = ((graph.MODEL_POINTS, _on_points), (graph.MODEL_TOPOLOGY, _on_topology),
              (graph.MODEL_POSITIONS, _on_positions))
    handlers = {'/' + topic.name: handle for topic, handle in wanted}
    with CellBag(bag) as reader:
        present = [name for name in handlers if name in reader.topics()]
        if '/' + graph.MODEL_POINTS.name not in present:
            return None
        tally = _Tally()
        for record, msg in reader.messages(present):
            handlers[record.topic](tally, record.topic, stamp_ns(msg) * 1e-9, msg)
    points, force = tally.get(('model', 'points')), tally.get(('model', 'force'))
    return Prediction(points.t, tally.points, points.values, tally.pads,
                      force.values.reshape(len(points), -1, 3), _tissue(tally))
