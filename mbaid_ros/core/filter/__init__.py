"""The trajectory filter: windows of knots, the predicted motion, and the square-root filter over both."""
