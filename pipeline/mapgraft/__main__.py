"""``python -m mapgraft``."""

from mapgraft.cli import main

main()
