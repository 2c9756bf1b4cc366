"""From a recording to a model: the fit, what is unknown about the recording, and what the fit is worth."""
