"""Choose the solver and the model for a controller from a run."""
