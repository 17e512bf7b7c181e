"""From readings to synchronised samples: streams, frames, noise, outliers."""
