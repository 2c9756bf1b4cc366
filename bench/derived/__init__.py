"""What follows from a table of measurements: pure functions, of which nothing is stored."""
