"""ROS 2 node of the iterated MAP by Gauss-Newton: `tissue_estimator` with `map`."""

from arm_brachy.nodes import tissue_estimator


def main(args=None):
    """Run the node."""
    tissue_estimator.run('map', args)
