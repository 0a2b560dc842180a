"""MissionError: the error of a mission that cannot be read, found, written or flown."""


class MissionError(ValueError):
    """A mission or its recording is not acceptable; the message says what, where, and what is accepted."""
