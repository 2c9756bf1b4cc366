"""The batch race."""
