"""What all other rooms stand on: arrays, rays, parameters, and the way to NumPy and back."""
