"""Numba kernels of the line maps: arrays in, arrays out."""

from mapgraft.contracts.kernels import share_cache

share_cache()  # before any of them is decorated
