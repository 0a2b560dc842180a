"""VectorNav in ASCII: ``$VNIMU`` or ``$VNYMR`` without time and attitude, and the GPS in ``$VNGPS``.

References
----------
VectorNav, *VN-200 User Manual* UM004, "Asynchronous output".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.data.protocols.sending import FrameEncoder, known_fields, sent_fix, vector
from writers.nmea import sentence

GAUSS, KILOPASCAL = 1e-4, 1e3
TYPES = {2: 2, 3: 3, 4: 4, 5: 7, 6: 8}
"""Number of a kind of fix by that of MAVLink."""


def lines(form: str, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
    """Return samples and fixes as lines of a form, ``VNIMU`` or ``VNYMR``."""
    return _Lines(form).encode(imu, fix)


class _Lines(FrameEncoder):
    def __init__(self, form: str) -> None:
        self._form = form

    def _sample(self, row: np.void) -> bytes:
        magnetic, force, rate = vector(row, "magnetic", GAUSS), vector(row, "force"), vector(row, "rate")
        cells = [f"{value:+08.4f}" for value in magnetic]
        cells += [f"{value:+07.3f}" for value in force] + [f"{value:+010.6f}" for value in rate]
        if self._form == "VNYMR":
            return sentence(",".join([self._form, "+000.000", "+000.000", "+000.000", *cells])).encode()
        temperature, pressure = known_fields(row, "temperature", "pressure")
        cells += [f"{temperature:+05.1f}", f"{pressure / KILOPASCAL:+08.3f}"]
        return sentence(",".join([self._form, *cells])).encode()

    def _fix(self, row: np.void) -> bytes:
        fix = sent_fix(row)
        cells = [f"{fix.week_time:013.6f}", "0000", f"{TYPES.get(fix.kind, 0)}", f"{fix.satellites:02d}"]
        cells += [f"{angle:+013.8f}" for angle in (fix.latitude, fix.longitude)]
        cells += [f"{value:+010.3f}" for value in (fix.height, *fix.velocity_n)]
        sigma = (fix.horizontal_sigma, fix.horizontal_sigma, fix.vertical_sigma, fix.speed_sigma)
        cells += [f"{value:+07.3f}" for value in sigma]
        return sentence(",".join(["VNGPS", *cells, "0.000000"])).encode()
