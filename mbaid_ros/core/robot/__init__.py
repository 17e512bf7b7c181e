"""The robot: its URDF, kinematics, momentum, and how both depend on what is measured."""
