"""From a recording to a model: the fit, the unknowns of the recording, and the adequacy of the fit."""
