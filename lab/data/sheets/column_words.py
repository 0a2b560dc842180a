"""Column words: words of column headings in other languages, and those that name a magnetometer.

Apps such as phyphox export in the language of the phone: ``Beschleunigung x (m/s^2)``, ``Temps (s)``. Phones
and loggers call a magnetometer ``Magnetic field x``, ``magnetometerX``, ``mag_x_uT``, ``Bx``; SensorLog on an
iPhone calls the field of its compass ``locationHeadingX``.
"""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

_WORDS = {
    "time": "zeit uhrzeit zeitstempel temps heure horodatage tiempo hora tempo",
    "date": "datum fecha",
    "acceleration": "beschleunigung beschleunigungssensor acceleration accelerometre aceleracion "
    "acelerometro accelerazione accelerometro",
    "linear": "lineare lineaire lineal",
    "gyroscope": "gyroskop drehrate winkelgeschwindigkeit rotationsrate giroscopio girometre",
    "magnetic": "magnetfeld magnetometre magnetique magnetico",
    "pressure": "druck luftdruck pression presion pressione",
    "gravity": "schwerkraft gravitation gravite gravedad gravita",
    "latitude": "breite breitengrad latitud latitudine",
    "longitude": "lange langengrad longitud longitudine",
    "altitude": "hohe hauteur altura altitud altezza altitudine",
    "speed": "geschwindigkeit vitesse velocidad velocita",
    "course": "richtung kurs cap direccion rumbo direzione rotta",
    "roll": "rollwinkel querneigung roulis alabeo balanceo rollio",
    "pitch": "nickwinkel langsneigung tangage cabeceo beccheggio",
    "yaw": "gierwinkel steuerkurs lacet guinada imbardata",
    "location": "ort standort localisation ubicacion posizione",
    "horizontal": "horizontale orizzontale",
    "vertical": "vertikale verticale",
    "accuracy": "genauigkeit precision exactitud precisione",
}
"""Words by their meaning, without accents; those that are spelled as in English are not needed."""
_PHRASES = {
    "vitesse angulaire": "gyroscope", "velocidad angular": "gyroscope", "velocita angolare": "gyroscope",
    "vitesse de rotation": "gyroscope", "champ magnetique": "magnetic", "campo magnetico": "magnetic",
}  # fmt: skip
"""Names of several words, of which one alone means something else."""
_MEANING = {word: meaning for meaning, words in _WORDS.items() for word in words.split()} | _PHRASES
_KNOWN = re.compile(
    rf"(?<![a-z])(?:{'|'.join(sorted(_MEANING, key=len, reverse=True))})(?![a-z])", re.IGNORECASE
)
_OF_ACCURACY = re.compile(r"(?i)accuracy (horizontal|vertical)")
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


@lru_cache(maxsize=4096)
def in_english(text: str) -> str:
    """Return a heading with the words of other languages in English; others are not changed.

    Parameters
    ----------
    text
        The heading, or the name of a file.
    """
    plain = "".join(map(_without_accent, unicodedata.normalize("NFC", text)))
    translated = _KNOWN.sub(lambda found: _MEANING[found[0].lower()], plain)
    return _OF_ACCURACY.sub(r"\1 accuracy", translated) if translated != plain else text


def _without_accent(character: str) -> str:
    """Return a letter without its accent; signs such as ° and ² stay."""
    base = unicodedata.normalize("NFD", character)[0]
    return base if base.isascii() and base.isalpha() else character
