"""Starts the cell's processes, watches them, collects their logs, ends them; leaves none behind.

Every node is a process of its own session, so that Ctrl-C reaches only the launcher, which then
ends the nodes in order: first those that do work, the recorder last. Should the launcher itself be
killed, the kernel sends its children SIGINT and they close on their own.
"""

import ctypes
import fcntl
import json
import os
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from arm_brachy import graph
from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.session import Session

DISCOVERY = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
PR_SET_PDEATHSIG = 1       # linux/prctl.h
DOMAINS = range(10, 100)   # ROS_DOMAIN_ID; up to 101 is safe on Linux whatever the port range
# For a tick where an estimator takes part: it computes modes or a gain before it connects.
ESTIMATOR_PATIENCE_S = 600.0
PATIENCE_S = 10.0          # for a process to end after SIGINT
STOPPED_PATIENCE_S = 0.5   # with a process that is stopped; it is looked at ten times a second
RECORDER_PATIENCE_S = 60.0  # a long bag writes its index at the end
# Found here, once: between fork and exec nothing may be loaded that another thread might hold.
_prctl = ctypes.CDLL(None).prctl


@dataclass(frozen=True)
class NodeProcess:
    """One process to start: node name, its ROS parameters, and the namespace of its cell."""

    name: str
    parameters: dict = field(default_factory=dict)
    namespace: str = ''

    def argv(self):
        """Command line; the module form works in a source tree and in an installation."""
        args = [sys.executable, '-m', 'arm_brachy.nodes', self.name, '--ros-args',
                '--params-file', str(ros_parameters())]
        for key, value in self.parameters.items():
            args += ['-p', f'{key}:={_ros_text(value)}']
        return args + (['-r', f'__ns:=/{self.namespace}'] if self.namespace else [])


def ros_parameters():
    """File of the ROS parameters that all nodes share."""
    return config_dir() / 'ros.yaml'


def _ros_text(value):
    """A parameter value as YAML on a command line; text is quoted so that it stays text."""
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(_ros_text(v) for v in value) + ']'
    return json.dumps(value) if isinstance(value, (bool, str)) else str(value)


def cell_processes(cell, scenario_path, bag, *, speed_limit=0.0, watch=False, viewer=True,
                   namespace=''):
    """The processes of a full run of a scenario, recorded into folder `bag`.

    namespace : of the cell, without a leading slash; several may then run in one domain
    watch : the model and the monitor that compares it with the sensors run beside the cell
    viewer : False leaves out the node that draws the cell for viewers, whatever the scenario says
    """
    wanted = {*graph.cell_of(cell.scenario, cell.scene.pads),
              *(n.name for n in graph.COMPARISON if watch)}
    wanted -= set() if viewer else {graph.CELL_VIEWER.name}
    names = [n.name for n in graph.NODES if n.name in wanted
             and (cell.scenario.pace == 'lockstep' or n is not graph.CELL_CLOCK)]
    common = {'scenario': str(scenario_path), 'peers': names,
              'session_key': str(session_key(bag))}
    extra = {'cell_clock': {'speed_limit': float(speed_limit), **_patience(names)},
             'recorder': {'output': str(bag)}}
    return [NodeProcess(n, {**common, **extra.get(n, {})}, namespace) for n in names]


def session_key(bag):
    """Where the key of the run that records into `bag` lies while it runs: beside the bag."""
    return Path(f'{bag}.key').absolute()


def replay_processes(cell, scenario_path, recording, live, bag):
    """The processes of a replay: the replayer, the live nodes, and the recorder of the result.

    live : names of nodes that run against the recording, which speaks for all others
    """
    wanted = {graph.CELL_CLOCK.name, graph.RECORDER.name, *live}
    absent = sorted(set(graph.cell_of(cell.scenario, cell.scene.pads)) - wanted)
    common = {'scenario': str(scenario_path), 'pace': 'lockstep',
              'peers': sorted(wanted | set(absent)), 'absent': absent}
    return [NodeProcess('replayer', {**common, 'bag': str(recording), **_patience(live)}),
            *(NodeProcess(n, common) for n in live),
            NodeProcess(graph.RECORDER.name, {**common, 'output': str(bag)})]


def _patience(names):
    """Parameters of whoever waits for the ticks of nodes `names`."""
    slow = {n.name for n in graph.ESTIMATOR_NODES} & set(names)
    return {'patience_s': ESTIMATOR_PATIENCE_S} if slow else {}


class Launcher:
    """Runs a set of node processes until the leader says that it has finished.

    processes : NodeProcess each, all of one namespace
    leader : name of the one whose progress ends the run
    log_dir : receives <node>.log;  on_progress(name, values) : called from `run`
    on_start(domain) : called before the first process, with its ROS_DOMAIN_ID
    """

    def __init__(self, processes, leader, log_dir, on_progress=lambda name, values: None,
                 on_start=lambda domain: None):
        self._specs, self._leader = tuple(processes), leader
        self._log_dir, self._on_progress = Path(log_dir), on_progress
        self._on_start = on_start
        self._children, self._listeners, self._lines = {}, {}, queue.Queue()
        self._interrupts, self._stopped = 0, {}

    def run(self):
        """Start, watch, end. Returns True if the leader finished, False after Ctrl-C.

        Raises ArmBrachyError naming the node that died and the last line of its log.
        """
        self._log_dir.mkdir(parents=True, exist_ok=True)
        before = {s: signal.signal(s, self._on_signal) for s in (signal.SIGINT, signal.SIGTERM)}
        with Domain(self._specs[0].namespace) as domain:
            keys = self._make_keys(domain)
            self._on_start(domain)
            try:
                for spec in self._specs:
                    self._start(spec, domain)
                return self._watch()
            finally:
                self._end_all()
                for key in keys:
                    key.unlink(missing_ok=True)
                for number, handler in before.items():
                    signal.signal(number, handler)

    def _make_keys(self, domain):
        """One key for the nodes that are to have one; returns its path in a set, empty if none."""
        keys = {Path(spec.parameters['session_key']) for spec in self._specs
                if spec.parameters.get('session_key')}
        for key in keys:
            Session.create(key, domain, self._specs[0].namespace)
        return keys

    def pid_of(self, name):
        """Process id of a node."""
        return self._children[name].pid

    def alive(self):
        """Names of the nodes whose processes have not ended."""
        return [name for name, child in self._children.items() if child.poll() is None]

    def _on_signal(self, number, frame):
        self._interrupts += 1

    def _start(self, spec, domain):
        log = (self._log_dir / f'{spec.name}.log').open('wb')
        child = subprocess.Popen(
            spec.argv(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log,
            env=_environment(domain, self._log_dir), start_new_session=True,
            preexec_fn=die_with_parent)
        log.close()
        self._children[spec.name] = child
        listener = threading.Thread(target=self._listen, args=(spec.name, child), daemon=True)
        self._listeners[spec.name] = listener
        listener.start()

    def _listen(self, name, child):
        for line in child.stdout:
            self._lines.put((name, line))

    def _watch(self):
        while not self._interrupts:
            try:
                name, line = self._lines.get(timeout=0.1)
            except queue.Empty:
                self._check_alive()  # returns if the last words of a dead one came meanwhile
                continue
            values = _progress(line)
            if values is None:
                continue
            self._on_progress(name, values)
            if name == self._leader and values.get('finished'):
                return True
        return False

    def _check_alive(self):
        for name, child in self._children.items():
            status = child.poll()
            if status is None:
                self._check_running(name, child)
                continue
            self._listeners[name].join(PATIENCE_S)
            if not self._lines.empty():
                return
            log = self._log_dir / f'{name}.log'
            error = ArmBrachyError(f'{name} ended with status {status}: {_last_line(log)} '
                                   f'(log: {log})')
            error.exit_status = 2 if status == 2 else 1
            raise error

    def _check_running(self, name, child):
        """A process that was stopped (SIGSTOP) neither dies nor answers: nobody else would say."""
        if not _is_stopped(child.pid):
            self._stopped.pop(name, None)
            return
        since = self._stopped.setdefault(name, time.monotonic())
        if time.monotonic() - since > STOPPED_PATIENCE_S:
            raise ArmBrachyError(f'{name} is stopped (SIGSTOP or a debugger) and the cell waits '
                                 f'for it; the run ends (log: {self._log_dir / name}.log)')

    def _end_all(self):
        last = [n for n in self._children if n == graph.RECORDER.name]
        self._end([n for n in self._children if n not in last], PATIENCE_S)
        self._end(last, RECORDER_PATIENCE_S)

    def _end(self, names, patience):
        """SIGINT, wait, and only then SIGKILL; further Ctrl-C do not cut the closing short."""
        for name in names:
            _signal(self._children[name], signal.SIGINT)
            _signal(self._children[name], signal.SIGCONT)   # a stopped one hears of it
        deadline = time.monotonic() + patience
        for name in names:
            try:
                self._children[name].wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                _signal(self._children[name], signal.SIGKILL)
                self._children[name].wait()


def _is_stopped(pid):
    """True if a process of ours is stopped: state T in /proc (Linux, proc(5))."""
    try:
        text = Path(f'/proc/{pid}/stat').read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return text.rsplit(')', 1)[1].split()[0] == 'T'


def _progress(line):
    try:
        return json.loads(line)['progress']
    except (ValueError, KeyError, TypeError):
        return None


def _last_line(log):
    lines = log.read_text(errors='replace').strip().splitlines()
    return lines[-1] if lines else 'it said nothing'


def _signal(child, number):
    if child.poll() is None:
        try:
            os.killpg(child.pid, number)
        except ProcessLookupError:  # it ended between the two lines
            pass


def die_with_parent():
    """For `preexec_fn`: the child gets SIGINT should the parent end, however it does."""
    _prctl(PR_SET_PDEATHSIG, signal.SIGINT)


def node_environment():
    """What every node runs under: one thread so that sums are reproducible, and this host only.

    Who sets ROS_AUTOMATIC_DISCOVERY_RANGE wants another range.
    """
    return {DISCOVERY: os.environ.get(DISCOVERY, 'LOCALHOST'), 'PYTHONUNBUFFERED': '1',
            'OMP_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1', 'NUMBA_NUM_THREADS': '1',
            'OPENBLAS_NUM_THREADS': '1'}


def _environment(domain, log_dir):
    return {**os.environ, **node_environment(), 'ROS_DOMAIN_ID': str(domain),
            'ROS_LOG_DIR': str(log_dir)}


def where(domain, namespace=''):
    """One line: where in DDS a cell of ROS_DOMAIN_ID `domain` is to be found."""
    inside = f', namespace /{namespace}' if namespace else ''
    return f'DDS domain {domain}{inside}, discovery {node_environment()[DISCOVERY]}'


class Domain:
    """A DDS domain for a run: $ROS_DOMAIN_ID, or one that no other run on this machine uses.

    namespace : of the cell, without a leading slash. Cells of different namespaces may share the
    domain of $ROS_DOMAIN_ID; two at the root, or two in one namespace, may not.
    The search starts elsewhere in every process: what a killed run left in the graph of its domain
    (until its lease ends) meets no new run.
    """

    def __init__(self, namespace=''):
        self._namespace = namespace

    def __enter__(self):
        given = os.environ.get('ROS_DOMAIN_ID', '')
        start = os.getpid() % len(DOMAINS)
        for number in [given] if given else (*DOMAINS[start:], *DOMAINS[:start]):
            self._lock = _lock(_place(number, self._namespace))
            if self._lock is not None:
                return number
        if given:
            raise ArmBrachyError(f'{_named(given, self._namespace)} is in use by another run on '
                                 'this machine; unset it, and a free domain is taken, or give '
                                 'each cell a --namespace of its own')
        raise ArmBrachyError(f'all of {len(DOMAINS)} DDS domains are in use on this machine; end '
                             'a run')

    def __exit__(self, *_):
        self._lock.close()


def cell_namespace(text):
    """The namespace of a cell as the launcher wants it: without a slash at either end.

    Raises InputError for what ROS allows no namespace to be.
    """
    name = text.strip('/')
    if name and not re.fullmatch(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', name, re.ASCII):
        raise InputError(f'namespace = {text!r}; must be words of letters, digits and _ that '
                         'begin with no digit, with single slashes between them')
    return name


def _place(domain, namespace):
    """What stands for a cell in the name of its lock: no word of a namespace holds a dot."""
    return '.'.join([str(domain), *namespace.split('/')]) if namespace else str(domain)


def _named(domain, namespace):
    name = f'ROS_DOMAIN_ID = {domain}'
    return f'namespace /{namespace} of {name}' if namespace else name


_claimed = {}      # domain -> its lock, for as long as this process lives


def claim_domain(domain, namespace=''):
    """Take a domain, or one namespace in it, for the life of this process; returns the domain.

    namespace : as `cell_namespace` gives it
    Raises ArmBrachyError while another cell on this machine has it.
    """
    place = _place(domain, namespace)
    if place not in _claimed:
        lock = _lock(place)
        if lock is None:
            raise ArmBrachyError(f'{_named(domain, namespace)} is in use by another cell on this '
                                 'machine; set another one, or give each cell a namespace')
        _claimed[place] = lock
    return domain


def _lock(place):
    """The locked file that stands for a domain, or None if somebody else holds it."""
    path = Path(tempfile.gettempdir()) / f'arm_brachy_domain_{place}.lock'
    try:
        file = path.open('w')
    except PermissionError:  # another user's
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    return file
