"""Registry: the public data sets of the scoreboard, with source, licence, protocol and published figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from lab.base.files.mission_error import MissionError
from lab.base.parameters.toml_file import read_toml

REGISTRY = Path(__file__).with_name("datasets.toml")
LAB = "INS Lab"
PROGRAMS = (LAB, "python-ins", "sidereon")
"""The programs that navigate each set, by the names under which pip installs the others."""


class Protocol(NamedTuple):
    """What is withheld from the programs.

    Attributes
    ----------
    basis : str
        Where the protocol is from.
    turns : int
        Number of turns, from one to the next one length later. In each, fixes follow an outage for twice as
        long.
    seconds : float
        Length of an outage [s]; 0: nothing is withheld, and the errors of the whole run count.
    first_s : float or None
        From the first fix to the first begin [s]; None: until the filter has settled.
    last_s : float
        From the last end to the last fix, at least [s].
    """

    basis: str
    turns: int
    seconds: float = 0.0
    first_s: float | None = None
    last_s: float = 0.0

    @property
    def words(self) -> str:
        """The protocol in words."""
        if not self.seconds:
            return "nothing withheld; errors of the whole run"
        begin = "after the filter has settled" if self.first_s is None else f"from {self.first_s:g} s on"
        turns = "once" if self.turns == 1 else f"in {self.turns} turns"
        return f"{self.seconds:g} s without fixes, fixes for twice as long, {begin}, {turns}"


class Published(NamedTuple):
    """A figure that others state.

    Attributes
    ----------
    program : str
        Whose figure it is.
    statistic : str
        One of `comparison.STATISTICS`.
    figure : float
        Its value, or the lower end of a range [m].
    kind : str
        A "result", the "range" of several, or a "tolerance" within which a test passes.
    where : str
        Where it is published.
    highest : float
        Upper end of a range [m].
    """

    program: str
    statistic: str
    figure: float
    kind: str
    where: str
    highest: float = 0.0


@dataclass(frozen=True)
class DataSet:
    """A public data set.

    Attributes
    ----------
    name, title : str
        Its name here, and what it is.
    source, licence : str
        Where it is published, and under which licence.
    layout : str
        How its files are laid out.
    against : str
        To what errors are differences: "fixes", "reference" or "truth".
    protocol : Protocol
        What is withheld.
    files : mapping of str to str
        SHA-256 of files by their name.
    settings : mapping
        Settings that all programs share.
    assumed : tuple of str
        Where these are from.
    published : tuple of Published
        Figures of others.
    structures : mapping of str to tuple
        File and structure of each part of a set of NaveGo.
    reference_at : str
        What the reference is the position of: "imu" or "antenna".
    lever_arm_m : tuple of float
        From the IMU to the antenna, forward, right, down [m].
    latency_s : float
        By how much the stamps of the fixes are late [s].
    imu_rpy_deg : tuple of float
        Rotation of the vehicle to the IMU, as GNSS_IMU configures it [°].
    imu_late_s : float
        By how much the stamps of the IMU are late [s].
    vehicle : str
        Kind of vehicle; empty if unknown.
    axes : tuple of str
        Axes of the IMU of a table that point forward, right, down; empty: the data show them.
    """

    name: str
    title: str
    source: str
    licence: str
    layout: str
    against: str
    protocol: Protocol
    files: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    published: tuple[Published, ...] = ()
    structures: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    reference_at: str = "imu"
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    latency_s: float = 0.0
    imu_rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    imu_late_s: float = 0.0
    vehicle: str = ""
    axes: tuple[str, ...] = ()

    @property
    def terms(self) -> tuple[str, ...]:
        """Where its protocol and its settings are from, in words."""
        shared = self.assumed or ("the lab's defaults, for all programs",)
        return (f"protocol: {self.protocol.basis}", *(f"settings: {one}" for one in shared))


@cache
def data_sets() -> dict[str, DataSet]:
    """Return the sets by name, in the order of the registry."""
    return {one.name: one for one in map(_make_data_set, read_toml(REGISTRY)["set"])}


def data_set(name: str) -> DataSet:
    """Return a set by its name.

    Raises
    ------
    MissionError
        If there is none of this name.
    """
    known = data_sets()
    if name not in known:
        raise MissionError(f"{name}: there is no data set of this name; accepted: {', '.join(known)}")
    return known[name]


def _make_data_set(table: Mapping[str, Any]) -> DataSet:
    made = dict(table)
    made["protocol"] = Protocol(**made["protocol"])
    made["published"] = tuple(Published(**one) for one in made.get("published", ()))
    made["assumed"] = tuple(f"{one['what']}: {one['basis']}" for one in made.get("assumed", ()))
    for name in ("lever_arm_m", "imu_rpy_deg", "axes"):
        if name in made:
            made[name] = tuple(made[name])
    return DataSet(**made)
