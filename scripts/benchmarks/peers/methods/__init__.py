"""One method a module: `identify`, what it needs to know beside the URDF, and what was tuned."""
