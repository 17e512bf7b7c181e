"""The simulated robot: its dynamics, environment and sensors."""
