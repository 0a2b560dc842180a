"""Destination: what may stand behind ``--to``, and what is refused with the words that are accepted."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.data.streams.transport import TransportError
from lab.live.outlets.destination import HOME, Destination


def test_a_destination_says_where_and_what() -> None:
    one = Destination.of("tcp:10110?protocol=nmea&hz=10&geoid=-32.5&talker=GP&utc=computer", 50)
    assert (one.kind, one.host, one.port, one.protocol, one.hz) == ("tcp", HOME, 10110, "nmea", 10)
    assert (one.geoid, one.talker, one.by_computer, one.is_open) == (-32.5, "GP", True, False)
    one = Destination.of("udp:[::1]:9870", 50)
    assert (one.host, one.port, one.protocol, one.hz, one.talker) == ("::1", 9870, "json", 50, "IN")
    assert math.isnan(one.geoid)
    assert not one.by_computer
    assert Destination.of("ws:8765?origin=https://App.Foxglove.dev, http://localhost:8080", 1).origins == {
        "https://app.foxglove.dev",
        "http://localhost:8080",
    }
    assert Destination.of("mcap:/tmp/A drive.MCAP", 1).path.name == "A drive.MCAP"


@pytest.mark.parametrize(
    ("text", "is_open"),
    [("tcp:0.0.0.0:1", True), ("ws:192.168.1.5:1", True), ("tcp:[::]:1", True), ("tcp:[::1]:1", False),
     ("ws:127.0.0.1:1", False), ("tcp:localhost:1", False), ("tcp:desk.example:1", True),
     ("udp:1.2.3.4:1", False)],
)  # fmt: skip
def test_whoever_listens_to_all_networks_is_told(text: str, is_open: bool) -> None:
    assert Destination.of(text, 1).is_open is is_open


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nowhere", "accepted are udp:COMPUTER:PORT, tcp:PORT"),
        ("serial:/dev/ttyUSB0", "no place to send to"),
        ("udp:127.0.0.1:0", "no port from 1 to 65535"),
        ("tcp:70000", "no port from 0 to 65535"),
        ("tcp:", "no port"),
        ("pty:/dev/pts/1", "pty takes no place"),
        ("mcap:drive.csv", "ends in .mcap"),
        ("mcap:drive.mcap?protocol=nmea", "'protocol' is no option of mcap; accepted are hz, geoid"),
        ("tcp:1?speed=2", "'speed' is no option of tcp"),
        ("tcp:1?origin=https://a.example", "'origin' is no option of tcp"),
        ("tcp:1?protocol=ubx", "accepted are json, nmea, mavlink"),
        ("tcp:1?hz=0", "accepted are 0.1 to 200"),
        ("tcp:1?hz=nan", "accepted are 0.1 to 200"),
        ("tcp:1?geoid=200", "accepted are -120 to 120"),
        ("tcp:1?talker=in", "two capital letters"),
        ("tcp:1?utc=mine", "accepted are receiver, computer"),
        ("ws:1?origin=*", "accepted are such as https://app.foxglove.dev"),
        ("ws:1?origin=https://a.example/path", "accepted are such as"),
        ("tcp:1?hz", "NAME=VALUE"),
    ],
)
def test_what_is_no_destination_is_refused(text: str, words: str) -> None:
    with pytest.raises(TransportError, match=words):
        Destination.of(text, 1)


@given(
    st.text()
    | st.builds("{}:{}?{}".format, st.sampled_from(["tcp", "ws", "udp", "mcap"]), st.text(), st.text())
)
def test_any_text_is_a_destination_or_refused(text: str) -> None:
    try:
        one = Destination.of(text, 1)
    except TransportError:
        return
    assert 0 <= one.port < 65536
