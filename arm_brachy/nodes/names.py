"""What a node that is no part of a cell finds in it: topics without its namespace, targets."""

from arm_brachy import graph

TARGETS = (graph.EM_POSE, *graph.ESTIMATES)     # whose last or middle part names a target


def topic_names(node):
    """Topics in the namespace of a node, without the namespace."""
    prefix = node.get_namespace().rstrip('/') + '/'
    return [name.removeprefix(prefix) for name, _ in node.get_topic_names_and_types()
            if name.startswith(prefix)]


def targets_of(node):
    """Names of the targets that somebody tracks or estimates, sorted."""
    names = topic_names(node)
    return sorted({name.split('/')[1 if topic is graph.EM_POSE else 2]
                   for name in names for topic in TARGETS if topic.matches(name)})
