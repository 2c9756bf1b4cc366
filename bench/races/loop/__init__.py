"""The closed-loop race."""
