"""The node graph as data: every topic and every node, once. No ROS is imported here.

The nodes, the launcher, `cell.launch.py`, the replayer and the README's table all read this file.
Topic names are relative (a namespace moves the whole cell); `{tool}`, `{pad}`, `{node}` are filled
in per instance.

Publishers always offer reliable delivery, which best-effort subscribers accept too; `reliable`
and `depth` are what a subscriber asks for when the cell is paced by the wall clock. In lockstep
every subscriber is reliable, since a tick is answered only when nothing is missing.
"""

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Topic:
    """One topic: name (template), message type, what a subscriber asks for, what it carries."""

    name: str
    type: str
    text: str
    depth: int = 10
    reliable: bool = True
    latched: bool = False

    def at(self, **names):
        """The topic of one tool, pad or node."""
        return Topic(self.name.format(**names), self.type, self.text, self.depth, self.reliable,
                     self.latched)

    def matches(self, name):
        """True if `name` is this topic or one of its instances."""
        pattern = re.sub(r'\\{\w+\\}', '[^/]+', re.escape(self.name))
        return re.fullmatch(pattern, name) is not None


CLOCK = Topic('clock', 'rosgraph_msgs/msg/Clock', 'simulated time, one message a tick', 1, False)
TICK_DONE = Topic('cell/done/{node}', 'arm_brachy_msgs/msg/TickDone',
                  'a node has answered a tick; how much it has published', 100)
SAFETY = Topic('cell/safety', 'arm_brachy_msgs/msg/SafetyState', 'run, hold or stop, and why',
               latched=True)
TASK = Topic('cell/task', 'arm_brachy_msgs/msg/TaskState',
             'what the operator is doing, or which prescribed move is under way', latched=True)
OUTCOME = Topic('cell/outcome', 'arm_brachy_msgs/msg/StepOutcome',
                'expected trouble, with advice', 100)
DIAGNOSTICS = Topic('diagnostics', 'diagnostic_msgs/msg/DiagnosticArray',
                    'health of every node, 1 Hz')
TF = Topic('tf', 'tf2_msgs/msg/TFMessage', 'frames that move: EM sensors, pads, needle tip, '
           'probe, links of the arm', 100)
TF_STATIC = Topic('tf_static', 'tf2_msgs/msg/TFMessage', 'frames that do not move: trackers, '
                  'template, base of the arm, image', 1, latched=True)

COMMAND = Topic('actuators/command', 'arm_brachy_msgs/msg/ActuatorCommand',
                'where the pads shall go', 100)
ACTUATORS = Topic('actuators/state', 'sensor_msgs/msg/JointState',
                  'encoder position, speed, motor force of every actuator', 100)
EM_POSE = Topic('em/{tool}/pose', 'geometry_msgs/msg/PoseStamped',
                'pose of an EM sensor; absent while it is missing')
EM_STATUS = Topic('em/{tool}/status', 'arm_brachy_msgs/msg/ToolStatus',
                  'status and quality of every EM frame')
OPTICAL = Topic('optical/markers', 'arm_brachy_msgs/msg/OpticalFrame',
                'all optical markers of a frame', 5, False)
WRENCH = Topic('force/{pad}/wrench', 'geometry_msgs/msg/WrenchStamped',
               "tissue on pad, in the pad's frame: axes of the base, moment about the displaced "
               'disc centre', 5, False)
MANIPULATION = Topic('manipulation/state', 'arm_brachy_msgs/msg/ManipulationState',
                     "the controller's belief and decision")

TRUTH_PADS = Topic('truth/pads', 'arm_brachy_msgs/msg/PadState', 'true pad positions', 100)
TRUTH_POINTS = Topic('truth/points', 'arm_brachy_msgs/msg/BodyPoints',
                     'true markers, targets, pad wrenches', 100)
TRUTH_TOPOLOGY = Topic('truth/mesh/topology', 'arm_brachy_msgs/msg/MeshTopology',
                       "the plant's mesh at rest", 1, latched=True)
TRUTH_POSITIONS = Topic('truth/mesh/positions', 'arm_brachy_msgs/msg/MeshPositions',
                        "the plant's nodes")
MODEL_POINTS = Topic('model/points', 'arm_brachy_msgs/msg/BodyPoints',
                     'what the model predicts for markers, targets and pad wrenches', 100)
MODEL_TOPOLOGY = Topic('model/mesh/topology', 'arm_brachy_msgs/msg/MeshTopology',
                       "the model's mesh at rest", 1, latched=True)
MODEL_POSITIONS = Topic('model/mesh/positions', 'arm_brachy_msgs/msg/MeshPositions',
                        "the model's nodes")

NEEDLE_COMMAND = Topic('needle/command', 'arm_brachy_msgs/msg/ActuatorCommand',
                       'how deep the needle shall go, and how its base is turned', 100)
NEEDLE_AIM = Topic('needle/aim', 'geometry_msgs/msg/PoseArray',
                   "where the tip will be at the target's depth, and where it is to be: two "
                   'positions, after each image of the tip')
NEEDLE_STATE = Topic('needle/state', 'sensor_msgs/msg/JointState',
                     'depth, speed and force of the needle; how its base is turned', 100)
NEEDLE_TIP = Topic('needle/tip', 'geometry_msgs/msg/PoseStamped',
                   'tip by depth sensor and template, z along the needle; absent outside the hole',
                   100)
PROBE_STATE = Topic('probe/state', 'arm_brachy_msgs/msg/ProbeState',
                    "what the probe's controller measures, believes and does", 100)
PROBE_JOINTS = Topic('probe/joint_states', 'sensor_msgs/msg/JointState',
                     'joints of the arm that holds the probe', 100)
PROBE_POSE = Topic('probe/pose', 'geometry_msgs/msg/PoseStamped',
                   'pose of the probe from the encoders: x along the elements, z out of the face',
                   100)
PROBE_WRENCH = Topic('probe/wrench', 'geometry_msgs/msg/WrenchStamped',
                     'tissue on probe, without weight and zero of the sensor, axes of the probe',
                     100)
ULTRASOUND_IMAGE = Topic('ultrasound/image', 'sensor_msgs/msg/Image', 'B-mode image', 5)
ULTRASOUND_OVERLAY = Topic('ultrasound/overlay', 'sensor_msgs/msg/Image',
                           "the image with the template's holes and the tip marked", 5)
ULTRASOUND_INFO = Topic('ultrasound/camera_info', 'sensor_msgs/msg/CameraInfo',
                        'pixels per metre of the image, and its corner', 5)
ULTRASOUND_TIP = Topic('ultrasound/tip', 'geometry_msgs/msg/PoseStamped',
                       'tip of the needle found in the image, placed by the encoders of the arm; '
                       'absent while it is not found')
ULTRASOUND_TARGET = Topic('ultrasound/target', 'geometry_msgs/msg/PoseWithCovarianceStamped',
                          'middle of the target, from its outlines in the images so far, by the '
                          'encoders of the arm; absent while it is not located')
SURFACE = Topic('surface/cloud', 'sensor_msgs/msg/PointCloud2', 'skin as a scanner sees it', 1,
                latched=True)
PROCEDURE = Topic('procedure/state', 'diagnostic_msgs/msg/DiagnosticArray',
                  'step of a procedure, its plan, its outcome', latched=True)
TRUTH_NEEDLE_PATH = Topic('truth/needle_path', 'geometry_msgs/msg/PoseArray',
                          'path that the needle cuts in tissue that stands still, template to '
                          'tip, z along it', 100)
TRUTH_NEEDLE = Topic('truth/needle', 'geometry_msgs/msg/PoseArray',
                     'true shaft of the needle as the tissue bends it, template to tip, z along '
                     'it', 100)
TRUTH_NEEDLE_FORCE = Topic('truth/needle_force', 'geometry_msgs/msg/WrenchStamped',
                           'tissue on needle', 100)
TRUTH_PROBE = Topic('truth/probe', 'geometry_msgs/msg/PoseStamped', 'true pose of the probe', 100)
TRUTH_CONTACT = Topic('truth/probe_contact', 'arm_brachy_msgs/msg/ProbeContact',
                      'what the tissue answers to the probe', 100)

# For viewers; nothing of the cell reads them.
MARKERS = Topic('cell/markers', 'visualization_msgs/msg/MarkerArray',
                'what the cell measures, estimates and wants, drawn', 5)
TRUTH_MARKERS = Topic('truth/markers', 'visualization_msgs/msg/MarkerArray',
                      'the simulated plant, drawn', 5)
JOINT_STATES = Topic('joint_states', 'sensor_msgs/msg/JointState',
                     'encoders of the actuators and of the arm, as robot_description names them',
                     100)
DESCRIPTION = Topic('robot_description', 'std_msgs/msg/String', 'URDF of actuators and arm', 1,
                    latched=True)

# Ways to see inside the tissue from markers and encoders; the node is `<name>_estimator`.
ESTIMATORS = ('kf_admm', 'graph_vae', 'map', 'pod')
FEEDBACKS = ('em', *ESTIMATORS)   # what the manipulator may hear a target from


def estimate(name):
    """Topic template of what an estimator says of each target."""
    return Topic(f'estimate/{name}/{{target}}', 'geometry_msgs/msg/PoseWithCovarianceStamped',
                 'where a target is, and its covariance; stamp = acquisition; absent while the '
                 'estimator cannot say')


def estimate_topology(name):
    """Topic of an estimator's mesh at rest."""
    return Topic(f'estimate/{name}/mesh/topology', 'arm_brachy_msgs/msg/MeshTopology',
                 "the estimator's mesh at rest", 1, latched=True)


def estimate_positions(name):
    """Topic of an estimator's nodes."""
    return Topic(f'estimate/{name}/mesh/positions', 'arm_brachy_msgs/msg/MeshPositions',
                 "the estimator's nodes")


# Moves something, or allows it: sealed with the key of the session, where there is one.
SEALED = (COMMAND, NEEDLE_COMMAND, SAFETY)
# Of a procedure: nobody says them where none of its nodes takes part.
PROBE_TOPICS = (
    NEEDLE_COMMAND, NEEDLE_AIM, NEEDLE_STATE, NEEDLE_TIP, PROBE_STATE, PROBE_JOINTS, PROBE_POSE,
    PROBE_WRENCH, ULTRASOUND_IMAGE, ULTRASOUND_OVERLAY, ULTRASOUND_INFO, ULTRASOUND_TIP,
    ULTRASOUND_TARGET, SURFACE, PROCEDURE,
    TRUTH_NEEDLE_PATH, TRUTH_NEEDLE, TRUTH_NEEDLE_FORCE, TRUTH_PROBE, TRUTH_CONTACT)
ESTIMATES = tuple(estimate(name) for name in ESTIMATORS)
ESTIMATED_MESHES = tuple(topic(name) for name in ESTIMATORS
                         for topic in (estimate_topology, estimate_positions))

TOPICS = (CLOCK, TICK_DONE, SAFETY, TASK, OUTCOME, DIAGNOSTICS, TF, TF_STATIC, COMMAND, ACTUATORS,
          EM_POSE, EM_STATUS, OPTICAL, WRENCH, MANIPULATION, TRUTH_PADS, TRUTH_POINTS,
          TRUTH_TOPOLOGY, TRUTH_POSITIONS, MODEL_POINTS, MODEL_TOPOLOGY, MODEL_POSITIONS,
          *PROBE_TOPICS, MARKERS, TRUTH_MARKERS, JOINT_STATES, DESCRIPTION,
          *(topic(name) for name in ESTIMATORS
            for topic in (estimate, estimate_topology, estimate_positions)))


@dataclass(frozen=True)
class NodeSpec:
    """One node: what it says and hears, and on whom its tick waits.

    same : nodes whose answer to the same tick it needs (within a tick, data flow downstream)
    previous : nodes whose answer to the tick before it needs (feedback edges)
    managed : has the services and the event topic of a ROS 2 lifecycle node beside its own
    """

    name: str
    text: str
    publishes: tuple = ()
    subscribes: tuple = ()
    same: tuple = ()
    previous: tuple = ()
    services: tuple = ()
    actions: tuple = ()
    managed: bool = False

    def hears(self, topic_name):
        """True if the node subscribes to the topic of this name."""
        return any(t.matches(topic_name) for t in self.subscribes)


EVERYWHERE = (OUTCOME, DIAGNOSTICS)
# Made by rcl for every managed node; nobody in the cell hears or calls them.
LIFECYCLE_EVENT = '~/transition_event'
LIFECYCLE_SERVICES = ('~/change_state', '~/get_state', '~/get_available_states',
                      '~/get_available_transitions', '~/get_transition_graph')

CELL_CLOCK = NodeSpec(
    'cell_clock', 'ticks simulated time; the next tick comes when every node has answered',
    publishes=(CLOCK,), subscribes=(TASK,))
ACTUATOR_DRIVER = NodeSpec(
    'actuator_driver', 'one bank of linear actuators, simulated or hardware',
    publishes=(ACTUATORS, TRUTH_PADS, *EVERYWHERE), subscribes=(COMMAND, SAFETY, TRUTH_POINTS),
    previous=('mpc_manipulator', 'supervisor', 'tissue_simulator', 'operator', 'push_protocol'),
    services=('~/home', '~/release'), managed=True)
TISSUE_SIMULATOR = NodeSpec(
    'tissue_simulator', 'the soft body that plays the patient',
    publishes=(TRUTH_POINTS, TRUTH_TOPOLOGY, TRUTH_POSITIONS, TRUTH_NEEDLE, TRUTH_NEEDLE_FORCE,
               TRUTH_CONTACT, *EVERYWHERE),
    subscribes=(TRUTH_PADS, TRUTH_NEEDLE_PATH, TRUTH_PROBE),
    same=('actuator_driver', 'needle_driver', 'probe_controller'))
TISSUE_MODEL = NodeSpec(
    'tissue_model', 'the same simulator as model: predicts from encoders what sensors should see',
    publishes=(MODEL_POINTS, MODEL_TOPOLOGY, MODEL_POSITIONS, *EVERYWHERE),
    subscribes=(ACTUATORS,), same=('actuator_driver',))
EM_TRACKER = NodeSpec(
    'em_tracker', 'electromagnetic tracker of sensors inside the tissue',
    publishes=(EM_POSE, EM_STATUS, TF, *EVERYWHERE), subscribes=(TRUTH_POINTS,),
    same=('tissue_simulator',))
OPTICAL_TRACKER = NodeSpec(
    'optical_tracker', 'optical tracker of markers on tissue, pads and base',
    publishes=(OPTICAL, *EVERYWHERE), subscribes=(TRUTH_POINTS,), same=('tissue_simulator',))
FORCE_SENSOR = NodeSpec(
    'force_sensor', 'one force-torque sensor behind each pad',
    publishes=(WRENCH, *EVERYWHERE), subscribes=(TRUTH_POINTS,), same=('tissue_simulator',))


def _estimator(name, text):
    return NodeSpec(
        f'{name}_estimator', text,
        publishes=(estimate(name), estimate_topology(name), estimate_positions(name),
                   *EVERYWHERE),
        subscribes=(OPTICAL, ACTUATORS, NEEDLE_STATE, NEEDLE_TIP, PROBE_STATE, PROBE_POSE,
                    PROBE_WRENCH),
        same=('optical_tracker', 'actuator_driver', 'needle_driver', 'probe_controller'))


KF_ADMM_ESTIMATOR = _estimator(
    'kf_admm', 'targets inside the tissue from markers and encoders: Kalman filter within ADMM')
GRAPH_VAE_ESTIMATOR = _estimator(
    'graph_vae', 'the same by ensemble smoothing in the latent space of a graph network')
MAP_ESTIMATOR = _estimator(
    'map', 'the same by Gauss-Newton on what the model may be wrong in, registration and offsets')
POD_ESTIMATOR = _estimator(
    'pod', 'the same by a Gaussian prior over modes of deformation, in closed form')
ESTIMATOR_NODES = (KF_ADMM_ESTIMATOR, GRAPH_VAE_ESTIMATOR, MAP_ESTIMATOR, POD_ESTIMATOR)

MPC_MANIPULATOR = NodeSpec(
    'mpc_manipulator', 'pushes the tissue so that a target meets its goal',
    publishes=(COMMAND, MANIPULATION, *EVERYWHERE),
    subscribes=(ACTUATORS, EM_POSE, *ESTIMATES, SAFETY),
    same=('actuator_driver', 'em_tracker', *(n.name for n in ESTIMATOR_NODES)),
    previous=('supervisor', 'operator'),
    services=('~/set_goal', '~/abort', '~/hold'), actions=('~/move_target',))
OPERATOR = NodeSpec(
    'operator', "plays the clinician: sets the scenario's goals, sends the pads home; conducts a "
    'procedure',
    publishes=(TASK, NEEDLE_COMMAND, NEEDLE_AIM, PROCEDURE, *EVERYWHERE),
    subscribes=(ACTUATORS, MANIPULATION, SAFETY, NEEDLE_STATE, PROBE_STATE,
                ULTRASOUND_TIP, ULTRASOUND_TARGET, SURFACE, *ESTIMATES),
    same=('actuator_driver', 'mpc_manipulator', 'needle_driver', 'probe_controller',
          'ultrasound_imager', 'surface_scanner', *(n.name for n in ESTIMATOR_NODES)),
    previous=('supervisor',))
PUSH_PROTOCOL = NodeSpec(
    'push_protocol', "makes the scenario's moves, without feedback: in place of mpc_manipulator "
    'and operator',
    publishes=(COMMAND, TASK, *EVERYWHERE), subscribes=(ACTUATORS, SAFETY),
    same=('actuator_driver',), previous=('supervisor',), services=('~/resume',))
SUPERVISOR = NodeSpec(
    'supervisor', 'health, limits, emergency stop: actuators move only while it says run',
    publishes=(SAFETY, *EVERYWHERE),
    subscribes=(ACTUATORS, WRENCH, NEEDLE_STATE, NEEDLE_TIP, PROBE_STATE),
    same=('actuator_driver', 'force_sensor', 'needle_driver', 'probe_controller'),
    services=('~/emergency_stop', '~/hold', '~/reset'), managed=True)
NEEDLE_DRIVER = NodeSpec(
    'needle_driver', 'the needle in its hole of the template: simulated motor or hand, and depth '
    'sensor',
    publishes=(NEEDLE_STATE, NEEDLE_TIP, TRUTH_NEEDLE_PATH, *EVERYWHERE),
    subscribes=(NEEDLE_COMMAND, SAFETY, TRUTH_NEEDLE_FORCE),
    previous=('tissue_simulator', 'supervisor', 'operator'), services=('~/release',))
PROBE_CONTROLLER = NodeSpec(
    'probe_controller', 'keeps the image plane on the tip at a constant force; the simulated arm '
    'included',
    publishes=(PROBE_STATE, PROBE_JOINTS, PROBE_POSE, PROBE_WRENCH, TRUTH_PROBE, *EVERYWHERE),
    subscribes=(NEEDLE_TIP, SURFACE, *ESTIMATED_MESHES, SAFETY, TRUTH_CONTACT),
    same=('needle_driver',),
    previous=('tissue_simulator', 'surface_scanner', 'supervisor', 'operator',
              *(n.name for n in ESTIMATOR_NODES)),
    services=('~/follow', '~/retract', '~/hold', '~/release'))
ULTRASOUND_IMAGER = NodeSpec(
    'ultrasound_imager', "images; over them the template's holes, tip and target as found, and "
    'where the tip will be',
    publishes=(ULTRASOUND_IMAGE, ULTRASOUND_OVERLAY, ULTRASOUND_INFO, ULTRASOUND_TIP,
               ULTRASOUND_TARGET, *EVERYWHERE),
    subscribes=(TRUTH_TOPOLOGY, TRUTH_POSITIONS, TRUTH_PROBE, TRUTH_CONTACT, TRUTH_NEEDLE,
                PROBE_POSE, NEEDLE_TIP, NEEDLE_AIM),
    same=('tissue_simulator', 'probe_controller', 'needle_driver'), previous=('operator',))
SURFACE_SCANNER = NodeSpec(
    'surface_scanner', 'scans the skin once at the start and on request',
    publishes=(SURFACE, *EVERYWHERE), subscribes=(TRUTH_TOPOLOGY, TRUTH_POSITIONS),
    same=('tissue_simulator',), previous=('operator',), services=('~/scan',))
PROBE_NODES = (NEEDLE_DRIVER, PROBE_CONTROLLER, ULTRASOUND_IMAGER, SURFACE_SCANNER)
MISMATCH_MONITOR = NodeSpec(
    'mismatch_monitor', 'compares the sensors with the prediction of tissue_model: says which '
    'channel departs, and since when',
    publishes=EVERYWHERE, subscribes=(MODEL_POINTS, OPTICAL, EM_POSE, WRENCH),
    same=('tissue_model', 'optical_tracker', 'em_tracker', 'force_sensor'))
CELL_VIEWER = NodeSpec(
    'cell_viewer', 'draws the cell for viewers (Foxglove, RViz): shapes, frames, robot model',
    publishes=(MARKERS, TRUTH_MARKERS, TF, TF_STATIC, JOINT_STATES, DESCRIPTION, *EVERYWHERE),
    subscribes=(ACTUATORS, OPTICAL, EM_POSE, WRENCH, MANIPULATION, *ESTIMATES, *ESTIMATED_MESHES,
                MODEL_TOPOLOGY, MODEL_POSITIONS, NEEDLE_STATE, NEEDLE_TIP, PROBE_POSE,
                PROBE_JOINTS, ULTRASOUND_TIP, TRUTH_POINTS, TRUTH_TOPOLOGY, TRUTH_POSITIONS,
                TRUTH_NEEDLE),
    same=('actuator_driver', 'tissue_simulator', 'tissue_model', 'em_tracker', 'optical_tracker',
          'force_sensor', *(n.name for n in ESTIMATOR_NODES), 'mpc_manipulator', 'needle_driver',
          'probe_controller', 'ultrasound_imager'))
RECORDER = NodeSpec(
    'recorder', 'writes every topic to an MCAP bag as raw bytes',
    subscribes=tuple(t for t in TOPICS if t is not CLOCK and t is not TICK_DONE),
    same=('actuator_driver', 'tissue_simulator', 'tissue_model', 'em_tracker', 'optical_tracker',
          'force_sensor', *(n.name for n in ESTIMATOR_NODES), 'mpc_manipulator', 'operator',
          'push_protocol', 'supervisor', *(n.name for n in PROBE_NODES), 'mismatch_monitor',
          'cell_viewer'))

NODES = (CELL_CLOCK, ACTUATOR_DRIVER, TISSUE_SIMULATOR, TISSUE_MODEL, EM_TRACKER, OPTICAL_TRACKER,
         FORCE_SENSOR, *ESTIMATOR_NODES, MPC_MANIPULATOR, OPERATOR, PUSH_PROTOCOL, SUPERVISOR,
         *PROBE_NODES, MISMATCH_MONITOR, CELL_VIEWER, RECORDER)
REPLAYER = 'replayer'  # stands in for the clock and for absent nodes; it is no part of a cell
COMPARISON = (TISSUE_MODEL, MISMATCH_MONITOR)   # run beside a cell, or on a recording
# A full run of a scenario with tasks that hears the EM tracker, and of one with moves.
CELL = tuple(n.name for n in NODES if n not in (
    *COMPARISON, *ESTIMATOR_NODES, *PROBE_NODES, PUSH_PROTOCOL))
PROBING_CELL = tuple(n.name for n in NODES if n not in (
    *COMPARISON, *ESTIMATOR_NODES, *PROBE_NODES, MPC_MANIPULATOR, OPERATOR))
PUSHING = (ACTUATOR_DRIVER, FORCE_SENSOR, MPC_MANIPULATOR)  # nothing to do without a pad


def cell_of(scenario, pads=True):
    """Names of the nodes that a full run of a Scenario takes, in table order.

    pads : the pads of its scene; empty or False for a body that nothing pushes
    Where the manipulator hears an estimator there is no sensor inside the tissue: no em_tracker.
    """
    wanted = set(PROBING_CELL if scenario.moves else CELL)
    wanted |= {f'{name}_estimator' for name in estimators_of(scenario)}
    if scenario.procedure is not None:
        wanted |= {n.name for n in PROBE_NODES}
    if not scenario.moves and scenario.feedback != 'em':
        wanted.discard(EM_TRACKER.name)
    if not scenario.viewer.on:
        wanted.discard(CELL_VIEWER.name)
    if not pads:
        wanted -= {n.name for n in PUSHING}
    return tuple(n.name for n in NODES if n.name in wanted)


def estimators_of(scenario):
    """Estimators that run in a Scenario: what the manipulator hears, and those beside it."""
    heard = () if scenario.moves or scenario.feedback == 'em' else (scenario.feedback,)
    return tuple(name for name in ESTIMATORS if name in (*heard, *scenario.estimators))


def conductor_of(scenario):
    """The node that walks through a Scenario and says when it is over."""
    return PUSH_PROTOCOL if scenario.moves else OPERATOR


def node(name):
    """The row of one node; KeyError if there is none."""
    return {n.name: n for n in NODES}[name]


def readers(topic_name, peers):
    """Names of the nodes among `peers` that subscribe to a topic, in table order."""
    return tuple(n.name for n in NODES if n.name in peers and n.hears(topic_name))


def instances(tools, pads, targets=()):
    """Every topic that the recorder keeps, templates filled in by EM tools, pads and targets."""
    return _filled(RECORDER.subscribes, tools, pads, targets)


def received(row, peers, *, tools=(), pads=(), targets=()):
    """Topics of a NodeSpec that somebody among `peers` publishes, templates filled in."""
    return tuple(t for t in _filled(row.subscribes, tools, pads, targets)
                 if writers(t.name, set(peers) - {row.name}))


def _filled(topics, tools, pads, targets):
    out = []
    for topic in topics:
        names = {'{tool}': tools, '{pad}': pads, '{target}': targets}
        field = next((f for f in names if f in topic.name), None)
        out += [topic] if field is None else [topic.at(**{field.strip('{}'): n})
                                              for n in names[field]]
    return tuple(out)


def waiters(name, peers):
    """Names of the nodes among `peers` that wait for the answers of node `name`, in table order.

    The clock waits for all.
    """
    return tuple(n.name for n in NODES if n.name in peers
                 and (name in (*n.same, *n.previous) or n is CELL_CLOCK))


def writers(topic_name, peers):
    """Names of the nodes among `peers` that publish a topic, in table order.

    None for a topic of a procedure where no node of one is among them.
    """
    if any(t.matches(topic_name) for t in PROBE_TOPICS) and not {
            n.name for n in PROBE_NODES} & set(peers):
        return ()
    return tuple(n.name for n in NODES if n.name in peers
                 and any(t.matches(topic_name) for t in n.publishes))


def is_shared(topic):
    """True for a topic that programs outside the cell may publish as well."""
    return topic in (CLOCK, TF, TF_STATIC, JOINT_STATES, DESCRIPTION, OUTCOME, DIAGNOSTICS)


def documentation_table():
    """The nodes and their topics as a Markdown table."""
    lines = ['| node | what it does | publishes | subscribes | services, actions |',
             '|---|---|---|---|---|']
    common = {OUTCOME.name, DIAGNOSTICS.name}
    for row in NODES:
        says = ', '.join(f'`{t.name}`' for t in row.publishes if t.name not in common)
        hears = 'every topic' if row is RECORDER else \
            ', '.join(f'`{t.name}`' for t in row.subscribes)
        offers = ', '.join([*(f'`{s}`' for s in row.services),
                            *(f'`{a}` (action)' for a in row.actions),
                            *(['[lifecycle](#lifecycle)'] if row.managed else [])])
        lines.append(f'| {row.name} | {row.text} | {says} | {hears} | {offers} |')
    return '\n'.join(lines)
