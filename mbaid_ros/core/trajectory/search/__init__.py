"""Where a young run is linearised: starts, passes, and when they are over."""
