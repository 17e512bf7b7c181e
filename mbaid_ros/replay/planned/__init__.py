"""Where a plan begins, and what is written of it."""
