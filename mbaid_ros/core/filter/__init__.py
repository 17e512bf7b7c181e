"""The trajectory filter: windows of knots, what conservation predicts of them, and the square-root filter over both."""
