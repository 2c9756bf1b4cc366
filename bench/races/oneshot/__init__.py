"""The one-shot race."""
