"""The graph of merges: what robots claim of their merges, what follows through third robots, what contradicts what."""
