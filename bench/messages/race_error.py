"""The error of a race that cannot be started or resumed."""


class RaceError(ValueError):
    """A race cannot be run as specified; the message is one sentence with the reason."""
