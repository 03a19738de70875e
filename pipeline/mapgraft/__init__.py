"""mapgraft: graft the maps of several robots into each other, verify, and take a wrong graft out again."""

__version__ = "0.1.0"
