"""From a run to a decision: which solver a controller gets, with what model, and why."""
