"""Whose message it is on a topic that several nodes, and strangers, publish."""

from arm_brachy import graph
from arm_brachy.nodes.convert import STATUS_PREFIX

EM_FRAME = 'em_'     # of a tool, as the EM tracker names it


def author_of(topic, upstream, frame):
    """Callable message -> name of the node that published it, None for a stranger.

    topic : graph.Topic;  upstream : names of the nodes that publish it in this run
    frame : frame_id of the base of the cell
    Returns None for a topic that only nodes of the cell may publish.
    """
    if topic.name in (graph.JOINT_STATES.name, graph.DESCRIPTION.name):
        return lambda msg: upstream[0] if upstream else None    # its number has to fit, too
    if topic.name in (graph.TF.name, graph.TF_STATIC.name):
        return lambda msg: _of_frames(msg, upstream, frame)
    return {graph.DIAGNOSTICS.name: _of_diagnostics,
            graph.OUTCOME.name: _of_outcome}.get(topic.name)


def _of_diagnostics(msg):
    names = {status.name for status in msg.status}
    name = names.pop() if len(names) == 1 else ''
    return name.removeprefix(STATUS_PREFIX) if name.startswith(STATUS_PREFIX) else None


def _of_outcome(msg):
    return msg.source


def _of_frames(msg, upstream, frame):
    """Frames of tools are the EM tracker's; others in our base the only other node's, if any."""
    if all(t.child_frame_id.startswith(EM_FRAME) for t in msg.transforms):
        return graph.EM_TRACKER.name
    others = [name for name in upstream if name != graph.EM_TRACKER.name]
    ours = any(t.header.frame_id == frame for t in msg.transforms)
    return others[0] if ours and len(others) == 1 else None
