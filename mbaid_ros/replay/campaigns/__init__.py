"""The executable `campaign`: one run, the folder of results, their statistics."""
