"""Merging: samples and fixes in the order in which a device would send them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Write = Callable[[np.void], bytes]


def merged(imu: NDArray[np.void], fix: NDArray[np.void], sample: Write, place: Write) -> bytes:
    """Return the frames of samples and fixes, each fix after the last sample that is not later.

    Parameters
    ----------
    imu : (n,) array of `lab.data.protocols.samples.IMU`
        Samples, in order.
    fix : (m,) array of `lab.data.protocols.samples.FIX`
        Fixes, in order. Those without a time follow all samples.
    sample, place
        Return the frame of a sample, and of a fix.
    """
    after = np.searchsorted(imu["time"], fix["time"], side="right") if len(imu) else np.zeros(len(fix), int)
    frames = []
    begin = 0
    for number, end in enumerate(after.tolist()):
        frames += [sample(row) for row in imu[begin:end]]
        frames.append(place(fix[number]))
        begin = max(begin, end)
    frames += [sample(row) for row in imu[begin:]]
    return b"".join(frames)
