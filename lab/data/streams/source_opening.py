"""Source opening: an address becomes a source."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lab.base.registry import find, names
from lab.data.protocols.column_map import ColumnMapError
from lab.data.streams.address import COMMON, Address
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.capture import parse_said
from lab.data.streams.network_transports import TcpConnection, UdpListener
from lab.data.streams.raw_recording import NEW_AXES, NEW_COLUMNS, NEW_UNIT, RecordingError
from lab.data.streams.recorded_log import make_reception
from lab.data.streams.replay import Replay
from lab.data.streams.sensor_server import SensorServerTransport
from lab.data.streams.serial_port import SerialPort
from lab.data.streams.source import Source
from lab.data.streams.transport import Transport, TransportError

SPEEDS = (0.1, 10.0)
"""Speeds of a replay that are accepted; beside them ``max``."""


def open_source(address: str | Address | Transport, **options: str) -> Source:
    """Return the source of an address; it reads from the beginning of a ``with``, or of `Source.start`.

    >>> import lab.live
    >>> with lab.live.open("serial:/dev/ttyUSB0?baud=115200&protocol=vectornav") as source:
    ...     read = source.since()

    Parameters
    ----------
    address
        An address as `lab.data.streams.address.FORMS` shows, or a transport of one's own.
    options
        Further options, as they may stand in the address: ``protocol``, ``columns`` of text, or ``column``
        and ``unit`` of those that are detected, ``axes``, ``rate`` [Hz] of a device without a clock.

    Raises
    ------
    TransportError
        If the address or an option is not accepted.
    DecoderError, ColumnMapError
        If protocol or columns are not accepted.
    MissionError, SettingError
        If a simulated device cannot fly the mission.
    """
    if isinstance(address, str):
        address = Address.of(address)
    if isinstance(address, Address):
        address = Address(address.kind, address.place, {**address.options, **options})
        options = dict(address.options)
    given = {name: value for name, value in options.items() if name in COMMON and name != "name"}
    # Before a flight is simulated; what a replay goes on with is in its header.
    is_replay = isinstance(address, Replay) or (isinstance(address, Address) and address.kind == "replay")
    reception = None if is_replay else make_reception({}, **given)
    transport = _maker(address.kind)(address) if isinstance(address, Address) else address
    if reception is None:
        reception = make_reception(transport.header if isinstance(transport, Replay) else {}, **given)
    source = Source(transport, reception, {"name": options.get("name", "")})
    if isinstance(transport, Replay) and "axes" not in options:
        transport.tell = lambda event: _follow(source, event)
    return source


def _maker(kind: str) -> Callable[[Address], Transport]:
    """Return what makes a transport of an address; that of a simulation is registered by `lab.live`."""
    if kind in _TRANSPORTS:
        return _TRANSPORTS[kind]
    if kind not in names("source"):
        raise TransportError(
            f"{kind}: is simulated by lab.live; import it, or open the source with lab.live.open"
        )
    return find("source", kind)


def _follow(source: Source, event: Mapping[str, Any]) -> None:
    """Take over from a recording what changed while it was made."""
    if NEW_AXES in event:
        source.axes = AxisMap.of(str(event[NEW_AXES]))
    try:
        if NEW_UNIT in event:
            source.answer(str(event[NEW_UNIT]))
        if NEW_COLUMNS in event:
            source.name_columns(parse_said(str(event[NEW_COLUMNS])))
    except ColumnMapError as error:
        raise RecordingError(f"the recording: {error}") from error


def _replay(address: Address) -> Replay:
    address.check(("speed",))
    fast = address.options.get("speed") == "max"
    speed = float("inf") if fast else address.number("speed", 1.0, *SPEEDS)
    given = {
        name: address.options[name]
        for name in ("protocol", "columns", "column", "rate")
        if name in address.options
    }
    return Replay(Path(address.place), speed, **given)


_TRANSPORTS: Mapping[str, Callable[[Address], Transport]] = {
    "serial": SerialPort,
    "udp": UdpListener,
    "tcp": TcpConnection,
    "replay": _replay,
    "sensorserver": lambda address: SensorServerTransport(f"sensorserver:{address.place}"),
}
