"""The anytime race."""
