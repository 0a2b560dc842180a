"""Source opening: an address becomes a source."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lab.live.address import Address, computer_and_port
from lab.live.axis_map import AxisMap
from lab.live.raw_recording import NEW_AXES
from lab.live.recorded_log import reception_of
from lab.live.replay import Replay
from lab.live.sensor_server import SensorServerTransport
from lab.live.serial_port import SerialPort
from lab.live.source import Source
from lab.live.tcp_connection import TcpConnection
from lab.live.transport import Transport, TransportError
from lab.live.udp_listener import UdpListener
from lab.sensors.suite import SensorSuite

SPEEDS = (0.1, 10.0)
"""Speeds of a replay that are accepted; beside them ``max``."""
SIMULATED_RATES = (1.0, 2000.0)
"""Rates of a simulated device [Hz]: above, its samples come several at a time."""
XPLANE_RATES = (10.0, 1000.0)
"""Rates of simulated sensors in X-Plane [Hz]: the curve of its motion has its knots at this rate."""
_LONGEST_REST = 3600.0  # before a flight, or of a device that stands still [s]
_USUAL_REST = 600.0  # of a device that stands still [s]
_MAX_CORRUPTION = 0.1  # part of the bytes: beyond, no frame is left
_MAX_JITTER = 1000.0  # [ms]
_MAX_DRIFT = 5000.0  # [ppm]: what a device clock follows
_MAX_SEED = 2**31


def open_source(address: str | Address | Transport, **options: str) -> Source:
    """Return the source of an address; it reads from the beginning of a ``with``, or of `Source.start`.

    >>> import lab.live
    >>> with lab.live.open("serial:/dev/ttyUSB0?baud=115200&protocol=vectornav") as source:
    ...     read = source.since()

    Parameters
    ----------
    address
        An address as `lab.live.address.FORMS` shows, or a transport of one's own.
    options
        Further options, as they may stand in the address: ``protocol``, ``columns`` of text, ``axes``,
        ``rate`` [Hz] of a device without a clock.

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
        transport: Transport = _TRANSPORTS[address.kind](address)
    else:
        transport = address
    known = transport.header if isinstance(transport, Replay) else {}
    given = {
        name: value for name, value in options.items() if name in ("protocol", "columns", "axes", "rate")
    }
    reception = reception_of(known, **given)
    source = Source(transport, reception, {"name": options.get("name", "")})
    if isinstance(transport, Replay) and "axes" not in options:
        transport.tell = lambda event: _follow(source, event)
    return source


def _follow(source: Source, event: Mapping[str, Any]) -> None:
    """Take over from a recording what changed while it was made."""
    if NEW_AXES in event:
        source.axes = AxisMap.of(str(event[NEW_AXES]))


def _replay(address: Address) -> Replay:
    address.check(("speed",))
    fast = address.options.get("speed") == "max"
    speed = float("inf") if fast else address.number("speed", 1.0, *SPEEDS)
    given = {
        name: address.options[name] for name in ("protocol", "columns", "rate") if name in address.options
    }
    return Replay(Path(address.place), speed, **given)


def _simulated(address: Address) -> Transport:
    # Simulating takes the whole laboratory, a serial port does not.
    from lab.live.simulated_device import Misbehaviour, SimulatedDevice  # noqa: PLC0415
    from lab.live.simulated_flight import REST, SimulatedFlight  # noqa: PLC0415
    from lab.live.simulated_link import link_of, local_link  # noqa: PLC0415
    from lab.live.simulated_transport import SimulatedTransport  # noqa: PLC0415

    address.check(
        ("device", "card", "hz", "seed", "rest", "over", "corruption", "jitter_ms", "drift_ppm", "mounted")
    )
    options = address.options
    mounted = options.get("mounted")
    flight = SimulatedFlight.of(
        address.place,
        address.number("hz", 100.0, *SIMULATED_RATES, "Hz"),
        sensor=options.get("card", ""),
        seed=address.whole("seed", 1, 0, _MAX_SEED),
        rest=address.number("rest", _USUAL_REST if address.place == REST else 0.0, 0.0, _LONGEST_REST, "s"),
        axes=AxisMap.of(mounted) if mounted else None,
    )
    over = options.get("over")
    if over is not None and over.startswith("udp"):
        raise TransportError(f"{address}: over = {over!r}; accepted are pty and tcp:0")
    misbehaviour = Misbehaviour(
        address.number("corruption", 0.0, 0.0, _MAX_CORRUPTION),
        1e-3 * address.number("jitter_ms", 0.0, 0.0, _MAX_JITTER, "ms"),
        1e-6 * address.number("drift_ppm", 0.0, -_MAX_DRIFT, _MAX_DRIFT, "ppm"),
    )
    link = local_link() if over is None else link_of(over)
    device = SimulatedDevice(flight, options.get("device", "vectornav"), link, misbehaviour)
    return SimulatedTransport(str(address), device)


def _xplane(address: Address) -> Transport:
    from lab.experiment import Experiment  # noqa: PLC0415 - as in `_simulated`
    from lab.sensors.cards import card  # noqa: PLC0415

    experiment = Experiment(mission="montreal")
    if "card" in address.options:
        card(address.options["card"]).load(experiment)
    return xplane_transport(address, experiment.sensors)


def xplane_transport(address: Address, sensors: SensorSuite, seed: int = 1) -> Transport:
    """Return simulated sensors in a running X-Plane.

    Parameters
    ----------
    address
        An address of the kind ``xplane``.
    sensors
        Their errors; a card in the address is not looked at.
    seed
        Of their random numbers, if the address gives none.

    Raises
    ------
    TransportError
        If an option is not accepted.
    """
    from lab.importing.xplane_live import PORT, RATES  # noqa: PLC0415 - a serial port needs none of it
    from lab.live.decoders.catalogue import ENCODERS  # noqa: PLC0415
    from lab.live.xplane_transport import XPlaneTransport  # noqa: PLC0415
    from lab.xplane.flight import XPlaneFlight  # noqa: PLC0415

    address.check(("card", "hz", "seed", "frames", "device", "mounted"))
    options = address.options
    place = address if ":" in address.place else Address(address.kind, f"{address.place}:{PORT}", options)
    device = options.get("device", "vectornav")
    if device not in ENCODERS:
        raise TransportError(f"{device!r} is no device; accepted are {', '.join(ENCODERS)}")
    mounted = options.get("mounted")
    flight = XPlaneFlight(
        sensors,
        address.whole("seed", seed, 0, _MAX_SEED),
        address.number("hz", 100.0, *XPLANE_RATES, "Hz"),
    )
    return XPlaneTransport(
        str(address),
        *computer_and_port(place),
        flight,
        ENCODERS[device](),
        address.number("frames", 50.0, *RATES, "Hz"),
        AxisMap.of(mounted) if mounted else None,
    )


_TRANSPORTS: Mapping[str, Callable[[Address], Transport]] = {
    "serial": SerialPort,
    "udp": UdpListener,
    "tcp": TcpConnection,
    "replay": _replay,
    "simulated": _simulated,
    "xplane": _xplane,
    "sensorserver": lambda address: SensorServerTransport(f"sensorserver:{address.place}"),
}
