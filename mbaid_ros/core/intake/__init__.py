"""What arrives, brought to common stamps and cut into windows."""
