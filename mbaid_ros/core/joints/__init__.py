"""Joints: their messages, their errors, their faults."""
