"""A batch is a loop in Python."""
