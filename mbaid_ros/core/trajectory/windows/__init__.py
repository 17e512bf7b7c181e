"""What has been measured, cut into windows of knots."""
