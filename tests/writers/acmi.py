"""Tacview ACMI 2.2 as a simulator writes it: ten frames a second, 7 decimals of a degree, changes alone."""

from __future__ import annotations

import numpy as np

from lab.missions import Recording
from writers.resampled import resampled

RATE = 10.0
LONGITUDE, LATITUDE = -74, 45


def write(recording: Recording, rate: float = RATE) -> bytes:
    """Return a file with the flight, and a second object that flies behind it for a while."""
    flight = resampled(recording, rate)
    lines = [
        "\ufeffFileType=text/acmi/tacview", "FileVersion=2.2", "0,ReferenceTime=2024-05-17T23:58:30Z",
        f"0,ReferenceLongitude={LONGITUDE}", f"0,ReferenceLatitude={LATITUDE}",
        "0,Comments=a text\\, with commas \\", "and a second line, T=1|2|3", "// no object",
    ]  # fmt: skip
    places = np.column_stack((
        np.degrees(flight.longitude) - LONGITUDE, np.degrees(flight.latitude) - LATITUDE, flight.height,
        np.degrees(flight.euler) % 360,
    ))  # fmt: skip
    places[:, 3:5] = (places[:, 3:5] + 180) % 360 - 180
    cells = [
        [f"{x:.7f}", f"{y:.7f}", f"{z:.2f}", *(f"{a:.3f}" for a in euler)]
        for x, y, z, *euler in places.tolist()
    ]
    before = [""] * 6
    for time, row in zip(flight.time.tolist(), cells, strict=True):
        lines.append(f"#{time:.2f}")
        changed = "|".join(cell if cell != old else "" for cell, old in zip(row, before, strict=True))
        if not before[0]:
            lines.append(rf"3000102,T={changed},Type=Air+FixedWing,Name=C172,Pilot=One\, Two,IAS=50.1")
        else:
            lines.append(f"3000102,T={changed},IAS={50 + time:.1f}")
        if time < 2:
            lines.append(f"b01,T={row[0]}|{row[1]}|{row[2]},Type=Weapon+Missile")
        elif time < 2 + 1 / rate:
            lines.append("-b01")
        before = row
    return "\n".join([*lines, ""]).encode()
