"""Motions of the joints that tell most of what is still uncertain, within limits."""
