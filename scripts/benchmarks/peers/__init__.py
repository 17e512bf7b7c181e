"""The same recordings identified by every method, side by side."""
