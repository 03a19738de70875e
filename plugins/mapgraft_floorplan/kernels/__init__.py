"""Numba kernels of floor plans: arrays in, arrays out."""

from mapgraft.contracts.kernels import share_cache

share_cache()  # before any of them is decorated
