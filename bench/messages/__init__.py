"""Messages between the parts of a race: a task goes down to a solver, an outcome comes back, and a row is saved."""
