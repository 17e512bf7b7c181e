"""Shared parts of the fuzzers: damage, formats, and how one input is tried."""
