"""Fault isolation: what is wrong with a run that contradicts its model."""
