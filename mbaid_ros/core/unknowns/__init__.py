"""Everything that is uncertain beside the pose: one file each, declared once, listed in `session/catalogue.py`."""
