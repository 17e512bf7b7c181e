"""Fault isolation: candidate causes for a run that contradicts its model."""
