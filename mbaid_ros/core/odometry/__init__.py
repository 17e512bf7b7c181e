"""The odometry of the base: its messages, its errors, its faults."""
