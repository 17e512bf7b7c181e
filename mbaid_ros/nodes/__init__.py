"""The live face: nodes on a ROS 2 graph."""
