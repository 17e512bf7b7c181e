"""Attacks on the nodes on a graph of their own: kills, garbage on every topic, services in a loop."""
