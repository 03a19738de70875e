"""The page on which people say whether merges are right: a server on this machine, for a browser on this machine."""
