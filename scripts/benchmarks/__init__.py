"""Measurements: accuracy, speed, and the paper's claims."""
