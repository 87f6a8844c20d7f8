"""ROS 2 shell of the model: predicts from the encoders what the sensors should see."""

from arm_brachy import graph
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.tissue_simulator import TissueNode


def model():
    """The body that estimators, controllers and comparisons believe in."""
    return TissueNode(graph.TISSUE_MODEL, 'model', graph.ACTUATORS, graph.MODEL_POINTS,
                      graph.MODEL_TOPOLOGY, graph.MODEL_POSITIONS)


def main(args=None):
    """Run the node."""
    spin_node(model, args)
