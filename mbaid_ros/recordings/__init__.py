"""Logs of real hardware that others made, as bags: each format a module, and tables for everybody else's."""
