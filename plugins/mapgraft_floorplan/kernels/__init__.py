"""Numba kernels of floor plans: arrays in, arrays out."""
