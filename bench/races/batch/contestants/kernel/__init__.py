"""A batch is one call of compiled code."""
