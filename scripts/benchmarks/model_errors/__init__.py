"""Robots that are not their URDF: whether the intervals hold that count on it, and the attainable errors."""
