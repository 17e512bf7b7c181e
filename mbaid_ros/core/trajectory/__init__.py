"""The trajectory-level estimator: the conservation law integrated and matched to the measured poses."""
