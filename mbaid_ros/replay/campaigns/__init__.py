"""The executable `campaign`: one run, its second motion, the folder of results, their statistics."""
