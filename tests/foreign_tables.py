"""Tables with the headings of other makers, and the check of what is read from them."""

from __future__ import annotations

import math

import numpy as np

UNIX = 1.7e9
"""Start of the mission, since 1970 [s]."""


def table(path, header, rows, separator=",", encoding="utf-8", comma=False, before=""):
    """Write a table; texts stay as they are, numbers are written with all digits, NaN is empty."""

    def cell(value):
        return value if isinstance(value, str) else "" if math.isnan(value) else f"{value:.16g}"

    if isinstance(rows, np.ndarray) and rows.dtype == np.float64 and not np.isnan(rows).any():
        row_format = separator.join(["%.16g"] * rows.shape[1])
        lines = [row_format % tuple(row) for row in rows.tolist()]
    else:
        lines = [separator.join(map(cell, row)) for row in rows]
    if comma:
        assert separator != ","
        lines = [line.replace(".", ",") for line in lines]
    path.write_bytes((before + "\n".join((header, *lines)) + "\n").encode(encoding))
    return path


def same(log, expected, tolerance=1e-6):
    """Check that a log has the samples and fixes of another one."""
    assert len(log.dtheta) == len(expected.dtheta)
    np.testing.assert_allclose(log.rates[0], expected.rates[0], atol=tolerance)
    np.testing.assert_allclose(log.rates[1], expected.rates[1], atol=10 * tolerance)
    np.testing.assert_allclose(log.gnss.time, expected.gnss.time, atol=1e-5)
    np.testing.assert_allclose(log.gnss.position, expected.gnss.position, atol=1e-9)
    np.testing.assert_allclose(log.gnss.velocity_n, expected.gnss.velocity_n, atol=1e-5)


def phone(vectors):
    """Return vectors in the axes of a phone with its top forward and its screen up."""
    return np.column_stack((vectors[:, 1], vectors[:, 0], -vectors[:, 2]))


def motion(gnss):
    return np.hypot(gnss[:, 4], gnss[:, 5]), np.degrees(np.arctan2(gnss[:, 5], gnss[:, 4])) % 360
