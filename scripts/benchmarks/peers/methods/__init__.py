"""One method a module: `identify`, its needs beside the URDF, and its tuning."""
