"""Aid table: the sensors besides IMU and GPS, each declared once; all other rooms are made from it.

Settings, readings, states, log files, streams, plots, verdict and budget iterate over the table. A row names
the class that simulates the sensor, and for a sensor that is not one of the first four the module in which a
filter sees it. Both are later files, so they are named as text and imported at the first use.
"""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from typing import Any

from lab.base.files.bounds import HEIGHTS, MAX_SPEED
from lab.base.files.named_columns import Column


@dataclass(frozen=True, kw_only=True)
class Aid:
    """A sensor besides IMU and GPS, with one number.

    Attributes
    ----------
    name : str
        Name: the group of its settings, its key in ``log.toml``, and the name of its random numbers.
    words : str
        The sensor in a sentence, such as "airspeed sensor".
    title, about : str
        Title of its settings on a page, and what they are, as a sentence.
    sensor : str
        Its settings and errors, a `lab.sensors.readings.AidSensor`, as ``"module:class"``.
    kinds : tuple of str
        What it measures, as shown: the first one, and other forms of it.
    unit, shown_unit : str
        SI unit of a reading, and its unit on pages and in tables.
    shown_scale : float
        Shown value of one SI unit.
    state : str
        The error for which a filter has a state: a name that ends with "bias" or "scale".
    file, column : str, Column
        File of its readings in the folder of a log, and their column with the values that are accepted. It
        is in the SI unit; headings, which are read by their own function, are in degrees.
    check : str
        How the readings of a log are compared with GPS or gyros: a key of
        `lab.data.checks.auxiliary_check.CHECKS`; empty for not at all.
    live : str
        Name of its readings in a stream; empty if streams have none.
    common : str
        The setting that its page always shows, beside whether it is fitted and its noise.
    belief : str
        Module with `see` and `see_by_matrices`, its h and H in compiled and in plain form; empty for the
        sensors that `lab.navigation.aids` knows itself.
    """

    name: str
    words: str
    title: str
    about: str
    sensor: str
    kinds: tuple[str, ...]
    unit: str
    shown_unit: str
    shown_scale: float = 1.0
    state: str
    file: str
    column: Column
    check: str = ""
    live: str = ""
    common: str
    belief: str = ""

    @property
    def is_scale(self) -> bool:
        """Whether the state is a scale factor; otherwise it is a bias."""
        return self.state.endswith("scale")

    @property
    def owner(self) -> str:
        """What its errors are called, such as "airspeed"."""
        return self.state.rpartition(" ")[0]

    @property
    def sigma(self) -> str:
        """The setting with σ of the constant part of the error that the state stands for."""
        return "scale_factor_sigma" if self.is_scale else "bias_sigma"

    @property
    def settings(self) -> Any:
        """The class of its settings."""
        module, _, name = self.sensor.partition(":")
        return getattr(importlib.import_module(module), name)


AIDS = (
    Aid(
        name="barometer",
        words="barometer",
        title="Barometer",
        about="Barometer errors.",
        sensor="lab.sensors.barometer:BarometerErrors",
        kinds=("height",),
        unit="m",
        shown_unit="m",
        state="barometer bias",
        file="baro.csv",
        column=Column("height_m", *HEIGHTS, may_be_empty=True),
        check="height",
        live="height",
        common="bias_sigma",
    ),
    Aid(
        name="heading",
        words="heading sensor",
        title="Heading sensor",
        about="Errors of a heading sensor.",
        sensor="lab.sensors.heading_sensor:HeadingErrors",
        kinds=("heading", "magnetic heading"),
        unit="rad",
        shown_unit="°",
        shown_scale=math.degrees(1.0),
        state="heading sensor bias",
        file="heading.csv",
        column=Column("heading_deg", -360.0, 360.0, required=False, may_be_empty=True),
        check="heading",
        live="heading",
        common="bias_sigma",
    ),
    Aid(
        name="odometer",
        words="odometer",
        title="Odometer",
        about="Odometer errors.",
        sensor="lab.sensors.odometer:OdometerErrors",
        kinds=("speed forward",),
        unit="m/s",
        shown_unit="m/s",
        state="odometer scale",
        file="odo.csv",
        column=Column("speed_m_s", -MAX_SPEED, MAX_SPEED, may_be_empty=True),
        check="speed",
        live="speed",
        common="scale_factor_sigma",
    ),
    Aid(
        name="airspeed",
        words="airspeed sensor",
        title="Airspeed sensor and wind",
        about="Errors of an airspeed sensor, and the wind.",
        sensor="lab.sensors.airspeed:AirspeedErrors",
        kinds=("airspeed",),
        unit="m/s",
        shown_unit="m/s",
        state="airspeed scale",
        file="air.csv",
        column=Column("airspeed_m_s", 0.0, MAX_SPEED, may_be_empty=True),
        check="airspeed",
        common="wind_sigma",
    ),
)
"""All of them, in the order of their settings."""

SERIES = tuple(aid for aid in AIDS if aid.name != "heading")
"""Those whose readings in a log are a file with times and one column; headings have a σ, or are a field."""
SENT = tuple(aid for aid in AIDS if aid.live and aid.name != "barometer")
"""Those whose readings devices send by themselves; heights by pressure come with the samples of an IMU."""
FURTHER = tuple(aid for aid in AIDS if aid.belief)
"""Those whose h and H are in a module of their own."""
