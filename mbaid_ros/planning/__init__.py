"""Motions of the arm that identify most within limits."""
