"""Decoder file: a decoder of the user's own, out of a Python file that whoever serves names."""

from __future__ import annotations

import math

import numpy as np

from lab.base.python_file import PythonFileError, describe_error, load_object
from lab.data.protocols.decoder import Decoder, DecoderError, Statistics
from lab.data.protocols.samples import FIX, IMU, NO_READINGS, READING, Samples

FORM = "FILE.py:Name, such as my_sensor.py:MyDecoder"


class OwnDecoder:
    """A decoder of the user's own, with what it leaves out; a `Decoder`.

    Only its `feed` is needed. A `name`, `statistics`, `wrap_period` and `finish` of its own are used.

    Parameters
    ----------
    place
        Where it comes from, for messages.
    decoder
        The user's object.
    """

    def __init__(self, place: str, decoder: object) -> None:
        self._place = place
        self._decoder = decoder
        self.name = str(getattr(decoder, "name", place.rpartition(":")[2]))
        self.wrap_period = float(getattr(decoder, "wrap_period", math.inf))
        own = getattr(decoder, "statistics", None)
        self._counts = not isinstance(own, Statistics)
        self.statistics = own if isinstance(own, Statistics) else Statistics()

    def feed(self, data: bytes) -> Samples:
        """Return what the user's decoder makes of the bytes.

        Raises
        ------
        DecoderError
            If it raises an exception, which is the error's cause, or returns no samples.
        """
        found = self._call_method("feed", data)
        if self._counts:
            self.statistics.bytes += len(data)
            self.statistics.frames += sum(map(len, found))
        return found

    def finish(self) -> Samples:
        """Return what it held back, if it has a method `finish`.

        Raises
        ------
        DecoderError
            As `feed`.
        """
        if not callable(getattr(self._decoder, "finish", None)):
            return Samples(np.empty(0, IMU), np.empty(0, FIX))
        return self._call_method("finish")

    def _call_method(self, method: str, *arguments: bytes) -> Samples:
        try:
            imu, fix, *others = getattr(self._decoder, method)(*arguments)
            (reading,) = others or [NO_READINGS]
        except (Exception, SystemExit) as error:
            raise DecoderError(f"{self._place}: failed by itself: {describe_error(error)}") from error
        for array, form, name in ((imu, IMU, "IMU"), (fix, FIX, "FIX"), (reading, READING, "READING")):
            if not isinstance(array, np.ndarray) or array.dtype != form or array.ndim != 1:
                raise DecoderError(
                    f"{self._place}: {method} returned {_kind(array)}; accepted is Samples(imu, fix) of "
                    f"lab.data.protocols.samples, here an array (n,) of {name}"
                )
        return Samples(imu, fix, reading)


def load_decoder(place: str) -> Decoder:
    """Return the decoder of a Python file, which is executed.

    Parameters
    ----------
    place
        ``FILE.py:Name``. The name is that of a class, called without arguments, or of a ready object.

    Raises
    ------
    DecoderError
        If there is no such file or name, if the file or the class fails, or if the object has no method
        `feed`.
    """
    try:
        return OwnDecoder(place, load_object(place, FORM, "feed(data)", "decoders in the file"))
    except PythonFileError as error:
        raise DecoderError(str(error)) from (error.__cause__ or error)


def _kind(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array {value.shape} of {value.dtype.names or value.dtype}"
    return f"a {type(value).__name__}"
