"""Whose message it is on a topic that several nodes, and strangers, publish."""

from arm_brachy import graph
from arm_brachy.nodes.convert import STATUS_PREFIX

EM_FRAME = 'em_'     # of a tool, as the EM tracker names it


def author_of(topic, upstream):
    """Callable message -> name of the node that published it, None for a stranger.

    topic : graph.Topic;  upstream : names of the nodes that publish it in this run
    Returns None for a topic whose messages do not tell.
    """
    told = {graph.DIAGNOSTICS.name: _of_diagnostics, graph.OUTCOME.name: _of_outcome,
            graph.TF.name: lambda msg: _of_frames(msg, upstream)}
    return told.get(topic.name)


def _of_diagnostics(msg):
    names = {status.name for status in msg.status}
    name = names.pop() if len(names) == 1 else ''
    return name.removeprefix(STATUS_PREFIX) if name.startswith(STATUS_PREFIX) else None


def _of_outcome(msg):
    return msg.source


def _of_frames(msg, upstream):
    """Frames of tools are the EM tracker's; all others the only other node's, if there is one."""
    if all(t.child_frame_id.startswith(EM_FRAME) for t in msg.transforms):
        return graph.EM_TRACKER.name
    others = [name for name in upstream if name != graph.EM_TRACKER.name]
    return others[0] if len(others) == 1 else None
