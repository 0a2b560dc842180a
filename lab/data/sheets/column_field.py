"""Column field: which words of a column heading name a magnetometer.

Phones and loggers call it ``Magnetic field x``, ``magnetometerX``, ``mag_x_uT``, ``Bx``; SensorLog on an
iPhone calls the field of its compass ``locationHeadingX``.
"""

from __future__ import annotations

import re

FIELD_WORDS = frozenset(
    {"magnetic", "magnetometer", "magnetometers", "mag", "magn", "magneto", "magneticfield", "geomagnetic",
     "vector"}
)  # fmt: skip
"""Words of a measured field; a vector is one only beside another of them."""
GLUED_FIELD = re.compile(r"(?i)^(?:(?:.*[\s_.:/-])?mag|[bm])([xyz])$")
"""A short name with its axis, such as ``mx`` or ``imu_magx``."""
_SHORT = {"b", "m", "locationheading"}
_COMPUTED = {
    "declination",
    "inclination",
    "ned",
    "enu",
    "earth",
    "world",
    "expected",
    "model",
    "offsets",
    "ofs",
}
"""Words of fields that are no measurement in the axes of the sensor."""


def names_field(words: frozenset[str], joined: str) -> bool:
    """Return whether the words of a heading, its axis cut off, name a measured magnetic field.

    Parameters
    ----------
    words
        The words.
    joined
        The same, put together.
    """
    named = words & (FIELD_WORDS - {"vector"}) or joined in _SHORT
    return bool(named) and not words & _COMPUTED
