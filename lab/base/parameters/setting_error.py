"""SettingError: the error of a setting that does not exist, or does not accept a value."""


class SettingError(ValueError):
    """An unknown setting, or a value that it does not accept; the message says what is accepted."""


class UnknownSettingError(SettingError):
    """A setting that does not exist."""


class RefusedValueError(SettingError):
    """A value that a setting does not accept."""
