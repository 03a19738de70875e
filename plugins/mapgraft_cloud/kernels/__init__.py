"""Numeric kernels of point-cloud maps: arrays in, arrays out, importing nothing of ours but each other."""

from mapgraft.contracts.kernels import share_cache

share_cache()  # before any of them is decorated
