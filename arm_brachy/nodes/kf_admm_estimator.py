"""ROS 2 node of the Kalman filter within ADMM: `tissue_estimator` with `kf_admm`."""

from arm_brachy.nodes import tissue_estimator


def main(args=None):
    """Run the node."""
    tissue_estimator.run('kf_admm', args)
