"""The attacked node."""
