"""Measurements: kernels, times, errors, and reports of them."""
