"""What the executable `campaign` works with: one run, who makes the runs, where results are kept, their statistics."""
