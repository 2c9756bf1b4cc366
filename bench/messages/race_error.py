"""How a race is refused."""


class RaceError(ValueError):
    """What is asked for cannot be raced; the message is one sentence that says why."""
