"""Capture: bytes of a device that another program saved, replayed by the times that are in them.

Such a file says nothing of when its bytes arrived. They are taken to have arrived when the samples in them
were measured, by the clock of the IMU, or else of the receiver.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray, running_sums
from lab.data.clock.faults import usual_step
from lab.data.clock.limits import LIMITS
from lab.data.protocols.catalogue import DECODERS, make_decoder
from lab.data.protocols.column_guess import advice_on_lines
from lab.data.protocols.column_map import ColumnMap
from lab.data.protocols.decoder import Decoder
from lab.data.protocols.recognition import recognise, sound_frames
from lab.data.protocols.samples import Samples, join_samples
from lab.data.protocols.text_cells import last_whole_lines
from lab.data.protocols.text_lines import TextLines
from lab.data.streams.raw_recording import (
    DATA,
    MAGIC,
    SUFFIX,
    RecordingError,
    open_recording,
    read_header,
    records,
)
from lab.data.streams.transport import Chunk, TransportError

RATES = (0.1, 10_000.0)
"""Rates of a device that are accepted [Hz]."""
LARGEST = 2**30
"""Largest capture [bytes]: ten hours at 30 kB/s, a device with 1 kHz. It is decoded as a whole first."""
_PIECE = 0.01
"""Least time between two arrivals [s]: bytes come in pieces, not one by one."""
_LOOKED_AT = 2**16
"""Bytes in which samples are looked for: two seconds at 30 kB/s."""
_BLOCK = 2**20
"""Bytes that are decoded at a time, while others wait for the interpreter."""

Records = Generator[tuple[int, Chunk], None, bool]


def header_of(path: str | os.PathLike[str], **options: str) -> dict[str, Any]:
    """Return what is known of the source of a raw recording, or of a capture of another program.

    Parameters
    ----------
    path
        The file.
    options
        Of a capture: ``protocol``, ``columns`` and ``column``, if they shall not be found out.

    Raises
    ------
    RecordingError
        If it cannot be read, or no protocol is recognised in it.
    """
    if _is_raw(path):
        return read_header(path)
    protocol, columns = options.get("protocol", ""), options.get("columns", "")
    if not protocol:
        protocol = "text" if columns or options.get("column") else _recognise_protocol(path)
    return {"protocol": protocol, "columns": columns}


def iterate_records(path: str | os.PathLike[str], **options: str) -> Records:
    """Yield the records of a raw recording, or of a capture, as `raw_recording.records` does.

    A capture is decoded as a whole first, which takes 0.2 s for a megabyte.

    Parameters
    ----------
    path
        The file.
    options
        Of a capture: as of `header_of`, and ``rate`` [Hz].

    Raises
    ------
    RecordingError
        If it cannot be read, no protocol is recognised in it, or nothing in it has a time.
    TransportError, DecoderError, ColumnMapError
        If rate, protocol or columns are not accepted.
    """
    if _is_raw(path):
        return records(path)
    header, data = header_of(path, **options), _data(path)
    columns, rate = header["columns"], parse_rate(options.get("rate") or 0.0)
    if header["protocol"] == TextLines.name:
        decoder: Decoder = TextLines(
            ColumnMap.of(columns) if columns else None, parse_said(options.get("column", ""))
        )
    else:
        decoder = make_decoder(header["protocol"])
    parts = [decoder.feed(data[at : at + _BLOCK]) for at in range(0, len(data), _BLOCK)]
    return _records(data, *_arrivals(path, join_samples([*parts, decoder.finish()]), rate))


def _is_raw(path: str | os.PathLike[str]) -> bool:
    return Path(path).suffix == SUFFIX or _read_first_bytes(path) == MAGIC


def parse_said(text: str) -> dict[str, str]:
    """Return what a person says of columns or units, by heading, number or quantity: ``rate=deg/s``.

    Parameters
    ----------
    text
        Several with semicolons between them.

    Raises
    ------
    TransportError
        If there is no ``=`` in one of them.
    """
    found = {}
    for one in filter(None, (part.strip() for part in text.split(";"))):
        name, sign, value = one.rpartition("=")
        if not sign or not name.strip() or not value.strip():
            raise TransportError(f"{one!r}; accepted is NAME=VALUE, such as rate=deg/s or ax=force_x[g]")
        found[name.strip()] = value.strip()
    return found


def parse_rate(value: Any) -> float:
    """Return a rate of samples [Hz], 0 for one that is to be found out.

    Raises
    ------
    TransportError
        If it is none.
    """
    try:
        rate = float(value)
    except (TypeError, ValueError):
        rate = np.nan
    if not (rate == 0 or RATES[0] <= rate <= RATES[1]):
        raise TransportError(f"rate = {value!r}; accepted are {RATES[0]:g} to {RATES[1]:g} Hz")
    return rate


def holds_samples(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a raw recording, or begins with samples that `iterate_records` reads.

    Any table of numbers looks like samples: whoever has a reader for the format asks that first.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    head = _read_first_bytes(path, _LOOKED_AT)
    found = recognise(head)
    return head.startswith(MAGIC) or bool(found and found[0].samples)


def _read_first_bytes(path: str | os.PathLike[str], size: int = len(MAGIC)) -> bytes:
    """Return the first bytes of a file."""
    with open_recording(path) as file:
        return file.read(size)


def _data(path: str | os.PathLike[str]) -> bytes:
    if not Path(path).is_file():  # a pipe could keep the reader waiting for ever
        raise RecordingError(f"{path}: is not an ordinary file")
    size = Path(path).stat().st_size
    if size > LARGEST:
        raise RecordingError(
            f"{path}: has {size / 2**30:.1f} GiB; accepted are captures up to {LARGEST / 2**30:.0f} GiB"
        )
    return _read_first_bytes(path, -1)


def _recognise_protocol(path: str | os.PathLike[str]) -> str:
    """Return the protocol of the first bytes."""
    found = recognise(_read_first_bytes(path, _LOOKED_AT))
    if not _read_first_bytes(path, 1):
        raise RecordingError(f"{path}: the file is empty")
    if not found:
        known = sound_frames(_read_first_bytes(path, _LOOKED_AT))
        if known:
            raise RecordingError(f"{path}: {known}")
        advice = advice_on_lines(last_whole_lines(b"\n" + _read_first_bytes(path, _LOOKED_AT)))
        raise RecordingError(
            f"{path}: is no raw recording of INS Lab, and no protocol is recognised in it; accepted are the "
            f"bytes of a device, as another program saved them, of the protocols {', '.join(DECODERS)}"
            + (f". {advice}" if advice else "")
        )
    return found[0].name


def _arrivals(
    path: str | os.PathLike[str], samples: Samples, rate: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the ends of the pieces in the capture, and their times of arrival [s]."""
    for rows, name in (
        (samples.imu, "time"),
        (samples.fix, "time"),
        (samples.fix, "week_time"),
        (samples.fix, "utc"),
        (samples.reading, "time"),
    ):
        known = np.isfinite(rows[name])
        if known.sum() > 1:
            times, ends = rows[name][known], rows["end"][known]
            break
    else:
        if not len(samples.imu):
            raise RecordingError(
                f"{path}: no sample is recognised in it. "
                + advice_on_lines(last_whole_lines(b"\n" + _read_first_bytes(path, _LOOKED_AT)))
            )
        if not rate > 0:
            raise RecordingError(
                f"{path}: nothing in it has a time, so that its samples cannot be timed; with --rate 100, or "
                "rate=100 in an address, they are taken to come 100 times a second"
            )
        times, ends = np.arange(len(samples.imu)) / rate, samples.imu["end"]
    order = np.argsort(ends, kind="stable")
    times, ends = times[order], ends[order]
    steps = np.diff(times)
    steps[(steps < 0) | (steps > LIMITS.forward)] = usual_step(times)  # the clock was set
    since = running_sums(steps)
    last = np.append(np.diff(np.floor(since / _PIECE)) > 0, True)
    return ends[last], since[last]


def _records(data: bytes, ends: NDArray[np.int64], arrivals: FloatArray) -> Records:
    begin = 0
    for end, arrival in zip(ends.tolist(), arrivals.tolist(), strict=True):
        if end > begin:
            yield DATA, Chunk(arrival, data[begin:end])
            begin = end
    if begin < len(data):
        yield DATA, Chunk(float(arrivals[-1]), data[begin:])
    return False
