"""The difference form: momentum equations of windows, their likelihood, and first solutions. No state."""
