"""What two maps of line segments say of a placement: one metric per module."""
