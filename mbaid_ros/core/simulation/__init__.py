"""A free-floating robot in motion, and what its sensors read."""
