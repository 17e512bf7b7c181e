"""Calibration of the robot itself, before a capture."""
