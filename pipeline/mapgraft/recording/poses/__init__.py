"""Where things were: frames, transforms in time, and lookups between samples."""
