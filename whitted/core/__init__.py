"""What every other room stands on: arrays, rays, parameters, and the way to and from NumPy."""
