"""Numba kernels of the line maps: arrays in, arrays out."""
