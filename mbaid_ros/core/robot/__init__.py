"""The robot: its URDF, kinematics, momentum, and their derivatives by the measurements."""
