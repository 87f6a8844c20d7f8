"""ROS 2 node of the Gaussian prior over modes of deformation: `tissue_estimator` with `pod`."""

from arm_brachy.nodes import tissue_estimator


def main(args=None):
    """Run the node."""
    tissue_estimator.run('pod', args)
