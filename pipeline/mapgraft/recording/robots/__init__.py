"""Whose scans and poses a recording holds: a glimpse of its files, discovery, configuration, and the resulting plan."""
