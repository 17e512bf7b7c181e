"""The identification itself: arrays in, arrays out; no ROS, no files, no clock."""
