"""Mistakes that are put into code, and the tests that may notice them."""
