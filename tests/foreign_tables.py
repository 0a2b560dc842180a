"""Tables with the headings of other makers, and the check of what is read from them."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import numpy as np

UNIX = 1.7e9
"""Start of the mission, since 1970 [s]."""
FLU = np.array((1, -1, -1))
"""Signs of vectors in axes forward, left, up."""
MPH = 0.44704
"""[m/s]."""


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


def track(made):
    """Return the fixes as columns: time, latitude, longitude, height, speed, course."""
    _, gnss = made
    return np.column_stack((gnss[:, :4], *motion(gnss)))


def moment(seconds, form):
    """Return a time of the mission as text, in UTC."""
    return datetime.fromtimestamp(UNIX + seconds, UTC).strftime(form)


def is_track(flight, made, height=1e-3, place=1e-7):
    """Check a flight against the fixes it was written from, once a second."""
    points = track(made)
    at = np.interp(flight.time - flight.time[0], points[:, 0] - points[0, 0], np.arange(len(points)))
    for values, column, tolerance in (
        (np.degrees(flight.latitude), 1, place), (np.degrees(flight.longitude), 2, place),
        (flight.height, 3, height),
    ):  # fmt: skip
        np.testing.assert_allclose(
            values, np.interp(at, np.arange(len(points)), points[:, column]), atol=tolerance
        )
