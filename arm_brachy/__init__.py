"""arm_brachy: a robotic cell for permanent-seed breast brachytherapy as a ROS 2 graph."""

__version__ = '0.1.0'
