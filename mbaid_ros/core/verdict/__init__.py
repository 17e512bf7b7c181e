"""Whether the model explains the data, and the likeliest causes where it does not."""
