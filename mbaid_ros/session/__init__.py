"""A run of the estimator, for both faces: messages go in, estimates and explanations come out."""
