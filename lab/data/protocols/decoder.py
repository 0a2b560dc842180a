"""Decoder: what turns the bytes of a device into samples, and encoder: what turns samples into such bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lab.data.protocols.samples import Samples


class DecoderError(ValueError):
    """There is no such decoder, or one's own failed to load; the message says why and what is accepted."""


@dataclass
class Statistics:
    """What a decoder has seen.

    Attributes
    ----------
    bytes : int
        Bytes fed.
    frames : int
        Frames that passed their check.
    skipped : int
        Bytes that belong to no frame that passed.
    failed : int
        Checks that failed: of damaged frames, and of bytes that only looked like the start of one.
    unknown : int
        Frames that passed their check and held nothing that the decoder reads.
    refused : int
        Samples outside the limits.
    """

    bytes: int = 0
    frames: int = 0
    skipped: int = 0
    failed: int = 0
    unknown: int = 0
    refused: int = 0


@runtime_checkable
class Decoder(Protocol):
    """Any object that decodes the bytes of one stream; it knows nothing of the transport.

    Attributes
    ----------
    name : str
        The protocol.
    statistics : Statistics
        What it has seen so far.
    wrap_period : float
        Time after which the device's clock starts again [s]: after a longer silence its times are wrong by a
        multiple of it. Infinite for a clock that does not.
    """

    name: str
    statistics: Statistics
    wrap_period: float

    def feed(self, data: bytes) -> Samples:
        """Return the samples whose frames end in these bytes, which follow those fed before.

        It raises nothing, whatever the bytes are, and keeps at most the bytes of its longest frame.

        Parameters
        ----------
        data
            Any bytes, of any number.
        """

    def finish(self) -> Samples:
        """Return the samples that were held back for more bytes, at the end of a stream.

        A damaged frame may claim to be longer than what is left of the stream, and hide frames behind it.
        """


@runtime_checkable
class Encoder(Protocol):
    """Any object that writes samples as a device would send them.

    Encoders of devices with headings or speeds also have ``encode_readings(reading)``, which returns the
    bytes of an array (k,) of `lab.data.protocols.samples.READING`.
    """

    name: str

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the bytes of samples, in the order of their time.

        Parameters
        ----------
        imu : (n,) array of `lab.data.protocols.samples.IMU`
            Samples of the IMU.
        fix : (m,) array of `lab.data.protocols.samples.FIX`
            Fixes; written by protocols that have them.
        """
