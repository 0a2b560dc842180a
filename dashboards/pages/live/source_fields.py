"""Source fields: which source a page watches, and how its bytes are read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import panel_material_ui as pmui

from dashboards.devices import STATIONS, allowed_devices
from dashboards.field_text import number
from dashboards.pages.live.wanted import Wanted
from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.session import Session
from dashboards.style import plain_column, wide_html
from lab.base.cache import digest
from lab.base.parameters.setting_error import SettingError
from lab.data.protocols.catalogue import DECODERS, ENCODERS
from lab.data.protocols.column_map import ColumnMap
from lab.data.protocols.text_lines import TextLines
from lab.data.streams.address import Address
from lab.data.streams.axis_map import AxisMap
from lab.experiment.experiment import Experiment
from lab.live import open as open_source
from lab.live.owner import Visitor
from lab.live.simulated.simulated_device import Misbehaviour, SimulatedDevice
from lab.live.simulated.simulated_flight import SimulatedFlight, missing_rest
from lab.live.simulated.simulated_link import local_link
from lab.live.simulated.simulated_transport import SimulatedTransport
from lab.live.station import Station
from lab.live.xplane.xplane_transport import xplane_transport

SIMULATED = "simulated"
"""Choice of the simulated device."""
XPLANE = "xplane:"
"""Before the place of a running X-Plane in its address."""
PHONE = "phone"
"""Choice of a phone that is yet to come."""
WATCHED = "watch "
"""Before the key of a station that another page has opened."""
RATES = (50, 100, 200, 500, 1000)
"""Rates of the simulated device [Hz]."""
REST = 12.0
"""Rest of a simulated flight that begins at rest [s]: ten whole seconds level the navigator and show the gyro
biases, and the first and the last second may be cut."""
FAULTS: dict[str, dict[str, Any]] = {
    "corrupt bytes": {"corruption": 1e-3},
    "jitter of 20 ms": {"jitter": 0.02},
    "clock 200 ppm fast": {"drift": 2e-4},
    "turned by 90°": {"axes": "y,-x,z"},
}
"""What a simulated device can be told to do wrong."""
_PROTOCOLS = {"found out": "", **{name: name for name in DECODERS}}
"""What is offered for a device whose address names no protocol."""
_FIELD: dict[str, Any] = {"size": "small", "variant": "outlined", "margin": (8, 4)}
_AS_SMALL = """
.MuiInputLabel-root[data-shrink="false"] { transform: translate(14px, 9px) }
"""
"""Style of a choice of several, which has no size, like that of the other fields."""

_OF_SIMULATED = (
    "The simulated device flies the mission of the settings with their sensors, and sends what they measure "
    "through the protocol of a real device. The navigator assumes the same sensors."
)
_OF_PHONES = (
    "A phone scans a QR code, opens one page, and streams its gyros, accelerometers and position. Hold it "
    "with the screen up and its top forward. The navigator assumes the sensors of the settings."
)
_OF_XPLANE = (
    "X-Plane sends its motion; on it, the sensors of the settings are simulated, or those of the card in the "
    "address. The navigator assumes the sensors of the settings. X-Plane must accept incoming connections "
    "(Settings, Network)."
)
_OF_OTHERS = "The navigator assumes the sensors of the settings: choose the card of this sensor there."
_OF_TEXT = (
    " The columns of text lines are detected and shown. To correct them, write them in the same form, and "
    "connect again."
)
_OF_WATCHED = (
    "Another page opened this source. That page has set its protocol, its axes and what the navigator "
    "assumes."
)


class Chosen(NamedTuple):
    """A chosen source.

    Attributes
    ----------
    key : str
        Key of its station.
    make : callable or None
        Makes the station; called in a thread. None if it is open already, and watched as it is.
    wanted : Wanted or None
        How a device is to be read; None if no other page can have opened it in another way, or if it is
        watched as it is.
    phone : int or None
        Number of the phone that came for it, which is told if it cannot be watched.
    """

    key: str
    make: Callable[[], Station] | None
    wanted: Wanted | None = None
    phone: int | None = None

    def open_station(self, watcher: object, visitor: Visitor) -> tuple[str, Station, list[str]]:
        """Return the station with its key, opened if it is not open.

        The third value is in what a station that another page has opened differs from what was chosen.
        """
        if (make := self.make) is None:
            return self.key, STATIONS.watch(self.key, watcher, visitor), []
        wanted, made = self.wanted, list[Station]()

        def make_one() -> Station:
            made.append(make())
            return made[-1]

        alone = wanted is not None and wanted.is_alone
        key, station = STATIONS.open(self.key, watcher, make_one, visitor, alone=alone)
        return (
            key,
            station,
            [] if wanted is None or station in made else wanted.differences(station),
        )


class SourceFields:
    """The choice of a source.

    Parameters
    ----------
    session
        Its mission, sensors and navigator are those of the simulated device and of the live navigator.

    Attributes
    ----------
    view : panel.Column
        The fields.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._answers: dict[str, dict[str, str]] = {}  # what was said of devices, by their addresses
        self._source = pmui.Select(
            label="Source", options=self._offers(), value=SIMULATED, **_FIELD, **layout_width(240)
        )
        self._source.param.watch(lambda _event: self._turn(), "value")
        self._device = pmui.Select(
            label="Device", options=[name for name in ENCODERS if name != "nmea"], value="vectornav",
            **_FIELD, **layout_width(130),
        )  # fmt: skip
        self._rate = pmui.Select(
            label="Rate",
            options={f"{rate} Hz": rate for rate in RATES},
            value=100,
            **_FIELD,
            **layout_width(100),
        )
        size = layout_width(220)
        self._faults = pmui.MultiChoice(
            label="Simulated fault",
            options=list(FAULTS),
            value=[],
            variant="outlined",
            margin=(8, 4),
            **size | {"stylesheets": [*size["stylesheets"], _AS_SMALL]},
        )
        self._protocol = pmui.Select(
            label="Protocol", options=_PROTOCOLS, value="", **_FIELD, **layout_width(140)
        )
        self._axes = pmui.TextInput(
            label="Axes forward, right, down",
            value="x,y,z",
            placeholder="x,y,z",
            **_FIELD,
            **layout_width(170),
        )
        self._columns = pmui.TextInput(
            label="Columns of text lines", placeholder="found out", **_FIELD, **layout_width(250)
        )
        self._protocol.param.watch(lambda _event: self._turn(), "value")
        self._heading = pmui.TextInput(
            label="Initial heading [°]", placeholder="found out", **_FIELD, **layout_width(170)
        )
        self._note = wide_html(margin=(0, 6), styles={"opacity": "0.7", "font-size": "13px"})
        self.view = plain_column(
            fields_row(
                self._source,
                self._device,
                self._rate,
                self._faults,
                self._protocol,
                self._columns,
                self._axes,
                self._heading,
            ),
            self._note,
        )
        self._turn()

    def refresh(self) -> None:
        """Offer what is there now."""
        offers = self._offers()
        value = self._source.value if self._source.value in offers.values() else SIMULATED
        self._source.param.update(options=offers, value=value)

    def follow(self) -> None:
        """Offer what is there now, if another source may be watched than when it was last offered."""
        offered = {name: value for name, value in self._source.options.items() if value.startswith(WATCHED)}
        if offered != self._watchable_sources():
            self.refresh()

    def offer_to_watch(self, key: str) -> None:
        """Choose a station that another page has opened."""
        self.refresh()
        if f"{WATCHED}{key}" in self._source.options.values():
            self._source.value = f"{WATCHED}{key}"

    def _offers(self) -> dict[str, str]:
        return {
            "Simulated device": SIMULATED,
            "A phone": PHONE,
            **allowed_devices(),
            **self._watchable_sources(),
        }

    def _watchable_sources(self) -> dict[str, str]:
        """Return what is open and may be watched from this page."""
        names = STATIONS.names(self._session.visitor())
        return {f"Watch: {name}": f"{WATCHED}{key}" for key, name in names.items()}

    def _turn(self) -> None:
        """Show the fields of the chosen source."""
        simulated = self._source.value == SIMULATED
        watched = str(self._source.value).startswith(WATCHED)
        xplane = str(self._source.value).startswith(XPLANE)
        for field in (self._device, self._rate, self._faults):
            field.visible = simulated
        phone = self._source.value == PHONE
        self._protocol.visible = not (simulated or watched or phone or xplane)
        given = self._given_options() if self._protocol.visible else {}
        self._offer_protocols(given.get("protocol", ""))
        self._columns.visible = self._protocol.visible and self._protocol.value in ("", TextLines.name)
        self._columns.placeholder = given.get("columns", "found out")
        self._axes.visible = not (watched or phone or xplane or "axes" in given)
        self._heading.visible = not watched
        kinds = {_OF_SIMULATED: simulated, _OF_PHONES: phone, _OF_XPLANE: xplane, _OF_WATCHED: watched}
        note = next((words for words, chosen in kinds.items() if chosen), _OF_OTHERS)
        self._note.object = f"<p>{note}{_OF_TEXT if self._columns.visible else ''}</p>"

    def keep(self, source: str, option: str, text: str) -> None:
        """Keep what a person said of a source, for the next time that it is opened.

        Parameters
        ----------
        source
            The device, as it is offered.
        option, text
            The option of its address, and its value.
        """
        self._answers.setdefault(source, {})[option] = text

    def _given_options(self) -> dict[str, str]:
        """Return the options with which this server opens the chosen device."""
        source = str(self._source.value)
        return Address.of(source).options if source in allowed_devices().values() else {}

    def _offer_protocols(self, given: str) -> None:
        """Offer the protocol that the address gives, or all if it gives none."""
        offers = {given: given} if given else _PROTOCOLS
        if self._protocol.options != offers:
            self._protocol.param.update(options=offers, value=given)

    def chosen(self) -> Chosen:
        """Return the chosen source.

        Raises
        ------
        ValueError
            If a field is not accepted, or the source is not there any more.
        """
        source = str(self._source.value)
        if source.startswith(WATCHED):
            return Chosen(source.removeprefix(WATCHED), None)
        experiment = self.settings()
        axes = AxisMap.of(str(self._axes.value_input or self._axes.value or "x,y,z"))
        sensors, navigator = experiment.sensors, experiment.navigator
        if source == SIMULATED:
            return self._choose_simulated(experiment, axes)
        if source not in allowed_devices().values():
            raise ValueError(
                f"{source}: this server does not open it; --allow-device of ins-lab serve allows it"
            )
        address = Address.of(source)
        if address.kind == XPLANE.removesuffix(":"):
            return self._xplane(address, experiment)
        options = {"axes": str(axes)} if self._axes.visible and not axes.is_identity else {}
        if self._protocol.value in DECODERS:
            options["protocol"] = str(self._protocol.value)
        columns = str(self._columns.value_input or self._columns.value or "").strip()
        if columns and self._columns.visible:
            options["columns"] = str(ColumnMap.of(columns))
        elif self._columns.visible:
            options |= self._answers.get(source, {})
        for name, value in options.items():
            if address.options.get(name, value) != value:
                raise ValueError(
                    f"{source}: {name} = {value}; this server opens it with {name} = {address.options[name]}"
                )
        wanted = Wanted(Address(address.kind, address.place, {**options, **address.options}), experiment)
        return Chosen(
            wanted.key(source),
            lambda: Station(open_source(wanted.address), sensors, navigator, source),
            wanted,
        )

    @property
    def wants_phone(self) -> bool:
        """Whether a phone is to be invited."""
        return bool(self._source.value == PHONE)

    def settings(self) -> Experiment:
        """Return the settings of the session, with the heading that was typed in.

        Raises
        ------
        ValueError
            If it is none.
        """
        experiment = self._session.experiment.copy()
        heading = str(self._heading.value_input or self._heading.value or "").strip()
        if heading:
            typed = number(heading)
            try:
                experiment.set("navigator.initial_heading", typed)
            except SettingError as error:
                raise ValueError(
                    f"Initial heading {heading!r}: accepted is a number from -360 to 360 °, or nothing"
                ) from error
        return experiment

    @staticmethod
    def _xplane(address: Address, experiment: Experiment) -> Chosen:
        """Return simulated sensors in X-Plane."""
        sensors, navigator = experiment.sensors, experiment.navigator
        by_card = "card" in address.options

        def make() -> Station:
            given = address if by_card else xplane_transport(address, sensors, experiment.seed)
            return Station(open_source(given), sensors, navigator, str(address))

        return Chosen(digest(str(address), experiment.to_dict()), make)

    def _choose_simulated(self, experiment: Experiment, axes: AxisMap) -> Chosen:
        """Return a simulated device."""
        device = self._device.value if self._device.value in ENCODERS else "vectornav"
        rate = float(self._rate.value) if self._rate.value in RATES else 100.0
        faults: dict[str, Any] = {}
        for name in self._faults.value:
            faults |= FAULTS.get(name, {})
        mounted = AxisMap.of(faults.pop("axes", "x,y,z"))
        key = digest(experiment.to_dict(), device, rate, sorted(self._faults.value), str(axes))
        name = ", ".join([f"{experiment.mission} as {device}", f"{rate:g} Hz", *sorted(self._faults.value)])

        def make() -> Station:
            flight = SimulatedFlight.of(
                experiment.mission,
                rate,
                seed=experiment.seed,
                rest=missing_rest(experiment.mission, REST),
                settings={"sensors": experiment.sensors.to_dict()},
                axes=mounted,
            )
            sender = SimulatedDevice(flight, device, local_link(), Misbehaviour(**faults))
            transport = SimulatedTransport(
                f"simulated:{experiment.mission}?device={device}&hz={rate:g}", sender
            )
            source = open_source(transport, axes=str(axes))
            return Station(source, experiment.sensors, experiment.navigator, name)

        return Chosen(key, make)
