"""Every parameter once: name, type, default, range, unit and description."""
