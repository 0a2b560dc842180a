"""Receivers: what real receivers claim, what is found, and whether the other half confirms it.

Run it with ``python -m tests.benchmarks.receiver_matrix [../shared]``. It prints, by kind of fix and axis,
the claimed σ, white and slow part, NIS per component of the second half with the sizes of the first, the same
with a σ that follows the innovations, and the error of fixes withheld for 10 s with the filter as it is and
with the found sizes.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

from lab.base.files.mission_error import MissionError
from lab.experiment.receiver import receiver
from lab.experiment.receiver_report import FITS
from tests.benchmarks.numbers_matrix import mission_of

RECEIVERS = (
    "recordings/rtkx_walk",
    "recordings/comma2k19",
    "recordings/vn310_static",
    "logs/copter_61.ulg",
    "logs/copter_delorean_1.bin",
    "logs/copter_delorean_92.bin",
    "logs/ublox_zed_f9p_mixed.log",
    "logs/ublox_8.nmea",
    "captures/ubx_gnss_imu_walk_1730_head256k.ubx",
)
"""Below the folder of shared data; the two of DeLorean are simulated by ArduPilot."""
MANY = 200
"""Fewest fixes of a kind that the count at the end takes."""


def main() -> None:
    """Print the table."""
    shared = Path(sys.argv[1] if len(sys.argv) > 1 else "../shared")
    confirmed, following, counted = 0, 0, 0
    print(
        f"{'receiver':34}{'fixes':>14}{'':>11}{'number':>7}{'claims':>9}{'white':>9}{'slow':>9}{'tau':>6}"
        f"{'NIS':>6}{'follows':>8}{'before':>8}{'after':>7}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name in RECEIVERS:
            path = shared / name
            if not path.exists():
                print(f"{path.name:34} is not there")
                continue
            is_log = path.is_dir() or path.suffix in (".ulg", ".bin")
            try:
                found = receiver(mission_of(path, Path(folder)) if is_log else path)
            except MissionError as error:
                print(error)
                continue
            for row in found.rows:
                figures = (
                    "        -" if math.isnan(one) else f" {one:8.3g}"
                    for one in (row.claimed, row.white, row.slow)
                )
                tau = "     -" if math.isnan(row.tau) else f"{row.tau:6.0f}"
                nis = "     -" if math.isnan(row.nis) else f"{row.nis:6.2f}"
                print(
                    f"{path.name[:33]:34}{row.kind:>14}{row.axis:>11}{row.fixes:7d}{''.join(figures)}{tau}{nis}"
                    f"{row.following:8.2f}{found.before:8.2f}{found.after:7.2f}",
                    flush=True,
                )
                if row.fixes >= MANY and math.isfinite(row.nis):
                    counted += 1
                    confirmed += FITS[0] <= row.nis <= FITS[1]
                    following += FITS[0] <= row.following <= FITS[1]
    print(f"NIS of {FITS[0]} to {FITS[1]}: {confirmed} of {counted} rows with {MANY} fixes or more")
    print(f"the same with a σ that follows the innovations: {following} of {counted}")


if __name__ == "__main__":
    main()
