"""Passive joints, which springs hold and no encoder reads."""
