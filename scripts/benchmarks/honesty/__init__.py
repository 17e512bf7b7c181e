"""Conditions that the estimator was not tuned for, and whether it is ever silently wrong in them."""
