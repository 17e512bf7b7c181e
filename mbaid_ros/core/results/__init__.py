"""What is said of a body: estimate, identifiability, physical consistency, status, the debris alone."""
