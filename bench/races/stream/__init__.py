"""The stream race."""
