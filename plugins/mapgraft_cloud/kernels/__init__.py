"""Numeric kernels of point-cloud maps: arrays in, arrays out, importing nothing of ours but each other."""
