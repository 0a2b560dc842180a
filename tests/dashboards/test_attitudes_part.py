"""The part Attitudes of the page Live: algorithms of whoever serves, and nothing of a visitor's."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from dashboards.algorithms import LIVE_VARIABLE, live_places, served_names
from dashboards.pages.live.attitudes_part import NONE, AttitudesPart
from dashboards.pages.live.watched import Watched
from lab.experiment.experiment import Experiment
from lab.live import open as open_source
from lab.live.station import Station

TEXT = """
class Still:
    def step(self, imu, fixes):
        return [1.0, 0.0, 0.0, 0.0]


class Evil:
    def step(self, imu, fixes):
        raise ValueError("<b>lost</b>")
"""


@pytest.fixture
def station() -> Iterator[Station]:
    experiment = Experiment()
    source = open_source("simulated:rest?device=vectornav")
    station = Station(source, experiment.sensors, experiment.navigator, "rest")
    yield station
    station.close()


@pytest.fixture
def part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AttitudesPart:
    path = tmp_path / "mine.py"
    path.write_text(TEXT, encoding="utf-8")
    monkeypatch.setenv(LIVE_VARIABLE, f"{path}:Still, {path}:Evil")
    return AttitudesPart(20.0, lambda: None)


def shown(part: AttitudesPart, station: Station, word: str) -> str:
    """Return what the part says once it has a word in it."""
    for _ in range(2000):
        part.advance()
        part.tell()
        words = str(part._words.object)
        if word in words:
            return words
        station.source.wait(station.source.end, 0.1)
    raise AssertionError(words)


def test_algorithms_of_streams_are_not_those_of_flights(part: AttitudesPart) -> None:
    assert list(live_places()) == ["Still", "Evil"]
    assert served_names() == ()
    assert part._choice.options == [NONE, "Still", "Evil"]
    assert part._choice.value == NONE


def test_a_chosen_algorithm_is_compared_and_words_of_its_file_are_no_markup(
    part: AttitudesPart, station: Station
) -> None:
    part.watch(Watched("rest", object(), station))
    part._choice.value = "Still"
    words = shown(part, station, "Still − truth")
    assert "Still follows." in words
    assert "sends no attitude of its own" in words
    assert part._grid.visible
    part._choice.value = "Evil"
    part.begin_anew()
    words = shown(part, station, "Evil: raised an exception")
    assert "&lt;b&gt;lost&lt;/b&gt;" in words
    assert "<b>" not in words
    part.watch(None)
    assert "Connect a source" in str(part._words.object)
    part.close()


@pytest.mark.parametrize("value", ["/etc/passwd:Name", "../mine.py:Still", "os:system", "", None, 7])
def test_a_visitor_names_no_file(part: AttitudesPart, station: Station, value: object) -> None:
    """A hand-made message may hold any value; what is no name of the server's runs nothing."""
    part.watch(Watched("rest", object(), station))
    part._choice = SimpleNamespace(value=value)  # type: ignore[assignment]
    part.advance()
    assert part._own is None
    assert not station._beside
