"""Results derived from a table of measurements by pure functions; nothing derived is stored."""
