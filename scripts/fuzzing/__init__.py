"""What the fuzzers share: damage, formats, and how one input is tried."""
