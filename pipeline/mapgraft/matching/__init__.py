"""Matching two ready maps from files, or a whole list of pairs whose truth is known."""
