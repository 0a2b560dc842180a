"""Our flight csv, as the lab writes it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from lab.missions import Recording, write_flight_csv


def write(recording: Recording) -> bytes:
    """Return the bytes of a flight csv."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.csv"
        write_flight_csv(path, recording)
        return path.read_bytes()
