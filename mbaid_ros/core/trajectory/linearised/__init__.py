"""What conservation predicts of a window, linearised and whitened."""
