"""The methods of identification by name."""

METHODS = ('trajectory', 'difference', 'paper_difference', 'paper_main')
