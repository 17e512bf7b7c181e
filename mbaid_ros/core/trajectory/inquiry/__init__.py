"""What may be wrong with a run that contradicts its model."""
