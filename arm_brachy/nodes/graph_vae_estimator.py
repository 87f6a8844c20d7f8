"""ROS 2 node of the ensemble smoother on a graph network: `tissue_estimator` with `graph_vae`."""

from arm_brachy.nodes import tissue_estimator


def main(args=None):
    """Run the node."""
    tissue_estimator.run('graph_vae', args)
