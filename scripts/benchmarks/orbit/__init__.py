"""Runs in orbit, and with wheels inside."""
