"""Models as C99 for a controller, as FMU for a simulator, and how fast that C is here."""
