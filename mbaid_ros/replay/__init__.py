"""The offline face: recorded bags, without a graph."""
