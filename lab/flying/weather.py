"""Weather: the air of a flight plan: wind, gusts, turbulence and temperature."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lab.flying.plan_table import TURNS, number


@dataclass(frozen=True)
class Gust:
    """A discrete gust of 1-cosine shape on top of the wind, as MIL-F-8785C, 3.7.4, has it.

    It rises from nothing as (1 - cos)/2, stays at its full size, and falls as it rose.
    """

    time_s: float = number(
        "Time", "s", (0, math.inf), "Time from the start of the flight to the start of the gust."
    )
    speed_m_s: float = number("Speed", "m/s", (0, 20), "Its horizontal speed at full size.", default=0.0)
    from_deg: float = number(
        "From", "°", TURNS, "True direction its horizontal part comes from.", default=0.0
    )
    updraught_m_s: float = number(
        "Updraught", "m/s", (-10, 10), "Its speed upwards at full size.", default=0.0
    )
    rise_s: float = number("Rise", "s", (0.1, 60), "Time to rise, and to fall.", default=2.0)
    hold_s: float = number("Hold", "s", (0, 600), "Time at full size.", default=0.0)

    def blows(self, time: float) -> bool:
        """Return whether the gust acts at a time from the start of the flight [s]."""
        return 0.0 < time - self.time_s < 2 * self.rise_s + self.hold_s

    def velocity_n(self, time: float) -> tuple[float, float, float]:
        """Return the velocity it adds to the air, north, east, down [m/s].

        Parameters
        ----------
        time
            Time from the start of the flight [s].
        """
        into = min(time - self.time_s, self.time_s + 2 * self.rise_s + self.hold_s - time)
        size = 0.5 * (1.0 - math.cos(math.pi * min(max(into / self.rise_s, 0.0), 1.0)))
        course = math.radians(self.from_deg)
        level = -size * self.speed_m_s
        return level * math.cos(course), level * math.sin(course), -size * self.updraught_m_s


@dataclass(frozen=True)
class Air:
    """The air the aircraft flies in; calm by default."""

    wind_from_deg: float = number("Wind from", "°", TURNS, "True direction the wind comes from.", default=0.0)
    wind_m_s: float = number("Wind", "m/s", (0, 25), "Speed of the wind.", default=0.0)
    turbulence_severity: int = number(
        "Turbulence severity",
        "",
        (0, 7),
        "0 none at all, 1-2 light, 3-4 moderate, 5-7 severe (MIL-F-8785C probability of exceedance "
        "curves): determines the turbulence more than 600 m above the ground.",
        default=0,
        whole=True,
    )
    turbulence_wind_m_s: float = number(
        "Turbulence wind",
        "m/s",
        (0, 25),
        "Wind 20 ft above the ground, which determines the turbulence less than 300 m above the ground.",
        default=0.0,
    )
    temperature_deviation_k: float = number(
        "Temperature deviation",
        "K",
        (-50, 35),
        "Difference of the temperature at every height to the standard atmosphere (15 °C at sea level).",
        default=0.0,
    )
    gusts: tuple[Gust, ...] = ()


CALM = Air()
"""No wind, no turbulence, the standard atmosphere."""
