"""Conditions that nobody has tuned the estimator for, and whether it is ever silently wrong in them."""
