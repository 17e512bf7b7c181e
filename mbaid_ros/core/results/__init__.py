"""Results: estimate, identifiability, physical consistency, status, the captured body alone."""
