"""Sent solution: what other programs read in lines of JSON, NMEA, MAVLink and messages of Foxglove."""

from __future__ import annotations

import io
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pynmeagps import VALCKSUM, NMEAReader
from sent_solutions import POSITION, solution

from lab.data.protocols.foxglove import CHANNELS, Conversation, make_messages
from lab.data.protocols.mavlink_encoder import MavlinkSolution
from lab.data.protocols.nmea_encoder import NmeaEncoder, encode_sentences
from lab.data.protocols.samples import READING
from lab.data.protocols.sent_solution import json_line, row_of

NAN = math.nan
UNKNOWN = np.full(3, NAN)
WAITING: dict[str, Any] = {
    "utc": NAN, "phase": "waiting", "latitude": NAN, "longitude": NAN, "height": NAN, "is_above_sea": None,
    "geoid": NAN, "position_covariance": np.full((3, 3), NAN), "velocity_n": UNKNOWN,
    "velocity_sigma": UNKNOWN, "euler": UNKNOWN, "euler_sigma": UNKNOWN, "has_heading": False,
    "attitude_covariance": np.full((3, 3), NAN), "rate": UNKNOWN,
}  # fmt: skip
"""Nothing is known."""


def read(data: bytes) -> dict[str, Any]:
    """Return the sentences that pynmeagps reads, by their names; it checks their sums."""
    reader = NMEAReader(io.BytesIO(data), validate=VALCKSUM, quitonerror=2)
    return {parsed.msgID: parsed for _, parsed in reader}


def test_a_line_of_json_has_units_in_its_names_and_no_number_that_json_lacks() -> None:
    line = json_line(solution())
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    assert len(line) < 1400  # of one datagram
    row = json.loads(line)
    assert row["latitude_deg"] == 45.5
    assert row["height_ellipsoid_m"] == 100.0
    assert row["height_sea_m"] == 130.0
    assert [row[f"{axis}_sigma_m"] for axis in ("north", "east", "down")] == [2.0, 3.0, 4.0]
    assert row["position_covariance_ned_m2"] == POSITION.tolist()
    assert json.loads(json_line(solution(**WAITING)))["heading_deg"] is None
    assert row.keys() == row_of(solution(**WAITING)).keys()


@pytest.mark.parametrize(
    ("is_above_sea", "geoid", "sea", "ellipsoid"),
    [(False, -30.0, 130.0, 100.0), (True, -30.0, 100.0, 70.0), (False, NAN, NAN, 100.0),
     (True, NAN, 100.0, NAN), (None, -30.0, NAN, NAN)],
)  # fmt: skip
def test_a_height_is_above_what_is_known(
    is_above_sea: bool | None, geoid: float, sea: float, ellipsoid: float
) -> None:
    one = solution(is_above_sea=is_above_sea, geoid=geoid)
    assert [one.sea_height, one.ellipsoid_height] == pytest.approx([sea, ellipsoid], nan_ok=True)
    altitude = read(encode_sentences(one))["GGA"].alt
    assert altitude == ("" if math.isnan(sea) else sea)
    assert (b"GLOBAL" in str(messages(one)).encode()) == math.isfinite(sea)


def test_another_parser_reads_the_sentences() -> None:
    found = read(encode_sentences(solution()))
    assert list(found) == ["GGA", "RMC", "VTG", "GST", "HDT"]
    gga, rmc, vtg, gst = (found[name] for name in ("GGA", "RMC", "VTG", "GST"))
    assert gga.talker == "IN"
    assert (gga.lat, gga.lon, gga.quality, gga.alt, gga.sep) == (45.5, -73.75, 1, 130.0, -30.0)
    assert str(gga.time) == "00:00:16.062000"
    assert str(rmc.date) == "2026-01-02"
    assert (rmc.status, rmc.posMode) == ("A", "A")
    assert rmc.spd == pytest.approx(5.0 * 3600 / 1852, abs=1e-3)
    course = math.degrees(math.atan2(-4.0, 3.0)) % 360
    assert rmc.cog == vtg.cogt == pytest.approx(course, abs=0.01)
    assert vtg.sogk == pytest.approx(18.0)
    assert vtg.sogn == rmc.spd
    assert (gst.stdLat, gst.stdLong, gst.stdAlt) == (2.0, 3.0, 4.0)
    assert found["HDT"].headingT == 300.0


def test_what_is_not_known_is_empty_and_a_coasting_position_is_an_estimate() -> None:
    found = read(encode_sentences(solution(**WAITING)))
    assert list(found) == ["GGA", "RMC", "VTG"]
    assert (found["GGA"].quality, found["RMC"].status, found["RMC"].posMode) == (0, "V", "N")
    assert found["GGA"].time == found["RMC"].date == ""
    found = read(encode_sentences(solution(coasts=True, has_heading=False), "GP"))
    assert "HDT" not in found
    assert (found["GGA"].quality, found["RMC"].posMode, found["VTG"].posMode) == (6, "E", "E")
    assert found["GGA"].talker == "GP"


def test_a_course_is_known_above_the_noise_only() -> None:
    still = solution(velocity_n=np.array([0.1, 0.1, 0.0]))
    assert math.isnan(still.course)
    assert read(encode_sentences(still))["RMC"].cog == ""


FAR = st.floats(-1e7, 1e7)


@given(
    st.floats(-90, 90),
    st.floats(-180, 180, exclude_max=True),
    st.tuples(FAR, FAR, FAR, FAR),
    st.floats(0, 360),
    st.floats(0, 4e9),
)
@example(90.0, -180.0, (0.0, 0.0, 0.0, 0.0), 359.9999, 0.0)
@example(-89.99999999, 179.99999999, (99999.99, 0.0, 0.0, 1.0), 360.0, 951_782_399.9996)
def test_no_sentence_is_too_long_or_lies(
    latitude: float, longitude: float, numbers: tuple[float, ...], heading: float, utc: float
) -> None:
    height, north, east, down = numbers
    one = solution(
        latitude=latitude, longitude=longitude, height=height, utc=utc, coasts=True,
        velocity_n=np.array([north, east, down]), euler=np.array([0.0, 0.0, heading]),
        position_covariance=np.diag([north**2, east**2, down**2]),
    )  # fmt: skip
    data = encode_sentences(one)
    assert data.isascii()
    lines = data.split(b"\r\n")
    assert lines.pop() == b""
    assert all(len(line) <= 80 and line.count(b"*") == 1 for line in lines)
    found = read(data)
    assert found["GGA"].lat == pytest.approx(latitude, abs=0.6e-5 / 60)
    assert (found["GGA"].lon - longitude + 180) % 360 - 180 == pytest.approx(0, abs=0.6e-5 / 60)
    assert 0 <= found["HDT"].headingT < 360
    assert found["VTG"].cogt == "" or 0 <= found["VTG"].cogt < 360
    assert found["GGA"].alt == "" or found["GGA"].alt == pytest.approx(height + 30, abs=0.006)


ANY = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(ANY, min_size=9, max_size=9), st.tuples(ANY, ANY, ANY), st.booleans())
def test_no_number_of_a_navigator_breaks_a_writer(
    matrix: list[float], vector: tuple[float, float, float], has_heading: bool
) -> None:
    three, square = np.array(vector), np.reshape(matrix, (3, 3))
    one = solution(
        height=vector[0], geoid=vector[1], velocity_n=three, velocity_sigma=three, euler_sigma=three,
        position_covariance=square, attitude_covariance=square, rate=three, has_heading=has_heading,
        is_above_sea=has_heading,
    )  # fmt: skip
    with np.errstate(over="ignore", invalid="ignore"):
        assert json.loads(json_line(one))
        assert read(encode_sentences(one))
        assert all(json.loads(data) for data in make_messages(one).values())
        assert "HEARTBEAT" in messages(one)


def test_a_heading_just_below_north_is_zero_and_not_360() -> None:
    rows = np.zeros(1, READING)
    rows["heading"] = np.radians(359.99999)
    assert NmeaEncoder().encode_readings(rows).startswith(b"$GNHDT,0.0000,T*")


def messages(*solutions: Any) -> dict[str, Any]:
    """Return the messages that pymavlink reads, by their names; the last of each."""
    common = pytest.importorskip("pymavlink.dialects.v20.common")
    writer, link = MavlinkSolution(), common.MAVLink(None)
    link.robust_parsing = False
    found = [one for each in solutions for one in link.parse_buffer(writer.written(each)) or []]
    assert [one.get_seq() for one in found] == list(range(len(found)))
    return {one.get_type(): one for one in found}


def test_another_parser_reads_the_messages_of_mavlink() -> None:
    found = messages(solution(time=10.0), solution(time=12.5))
    assert set(found) == {
        "HEARTBEAT", "SYSTEM_TIME", "ATTITUDE", "GLOBAL_POSITION_INT", "GLOBAL_POSITION_INT_COV", "VFR_HUD"
    }  # fmt: skip
    place, spread, attitude = (
        found[name] for name in ("GLOBAL_POSITION_INT", "GLOBAL_POSITION_INT_COV", "ATTITUDE")
    )
    assert (place.lat, place.lon, place.alt, place.relative_alt) == (455_000_000, -737_500_000, 130_000, 0)
    assert (place.vx, place.vy, place.vz, place.hdg, place.time_boot_ms) == (300, -400, 50, 30_000, 2500)
    matrix = np.reshape(spread.covariance, (6, 6))
    assert matrix[:3, :3] == pytest.approx(POSITION)
    assert np.diagonal(matrix)[3:] == pytest.approx([0.01, 0.04, 0.09])
    assert attitude.yaw == pytest.approx(math.radians(-60))
    assert attitude.pitch == pytest.approx(math.radians(-2))
    assert found["SYSTEM_TIME"].time_unix_usec == 1_767_312_016_062_400
    assert found["VFR_HUD"].groundspeed == pytest.approx(5.0)


def test_mavlink_sends_no_heading_and_no_place_that_is_not_known() -> None:
    found = messages(solution(**WAITING))
    assert set(found) == {"HEARTBEAT", "SYSTEM_TIME"}
    assert found["SYSTEM_TIME"].time_unix_usec == 0
    found = messages(solution(has_heading=False, velocity_n=np.array([900.0, 0.0, 0.0])))
    assert math.isnan(found["ATTITUDE"].yaw)
    assert found["GLOBAL_POSITION_INT"].hdg == 65_535
    assert found["GLOBAL_POSITION_INT"].vx == 32_767  # at the end of its range
    assert messages(solution(time=50.0), solution(time=1.0))["ATTITUDE"].time_boot_ms == 0  # set back


def test_foxglove_gets_east_north_up() -> None:
    found = {number: json.loads(data) for number, data in make_messages(solution()).items()}
    fix = found[2]
    assert np.reshape(fix["position_covariance"], (3, 3)) == pytest.approx(
        np.array([[9.0, 1.0, 0.25], [1.0, 4.0, -0.5], [0.25, -0.5, 16.0]])
    )
    assert fix["altitude"] == 100.0
    assert fix["timestamp"] == {"sec": 1_767_312_016, "nsec": 250_000_000}
    assert found[1]["latitude_deg"] == 45.5
    # Heading east, level: forward is the first axis of east, north, up, and nothing is turned.
    level = json.loads(make_messages(solution(euler=np.array([0.0, 0.0, 90.0])))[3])["rotation"]
    assert [abs(level[axis]) for axis in "xyzw"] == pytest.approx([0, 0, 0, 1], abs=1e-12)
    # Nose up by 30° while heading east: the nose, which is x, points up.
    x, y, z, w = json.loads(make_messages(solution(euler=np.array([0.0, 30.0, 90.0])))[3])[
        "rotation"
    ].values()
    assert 2 * (x * z - w * y) == pytest.approx(math.sin(math.radians(30)))
    assert set(make_messages(solution(**WAITING))) == {1}
    assert "altitude" not in json.loads(make_messages(solution(is_above_sea=True, geoid=NAN))[2])


def test_a_conversation_takes_subscriptions_and_nothing_else() -> None:
    conversation = Conversation()
    info, offer = (json.loads(text) for text in conversation.greetings())
    assert info["op"] == "serverInfo"
    assert [one["topic"] for one in offer["channels"]] == [one.topic for one in CHANNELS]
    assert all(json.loads(one["schema"])["type"] == "object" for one in offer["channels"])
    for hostile in (
        b"\x01\x00", "", "{", "[1]", "[" * 5000, '{"op": "subscribe"}',
        '{"op": "subscribe", "subscriptions": 3}', '{"op": "advertise", "channels": []}',
        '{"op": "subscribe", "subscriptions": [1, {}, {"id": -1, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": true, "channelId": 1}, {"id": 1, "channelId": 99}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 1e99, "channelId": 1}]}',
        '{"op": "unsubscribe", "subscriptionIds": [[], "1", 7]}',
    ):  # fmt: skip
        conversation.accept(hostile)
        assert conversation.written(5, {1: b"x", 2: b"y", 3: b"z"}) == []
    conversation.accept('{"op": "subscribe", "subscriptions": [{"id": 300, "channelId": 2}]}')
    expected = b"\x01" + (300).to_bytes(4, "little") + (5).to_bytes(8, "little") + b"y"
    assert conversation.written(5, {1: b"x", 2: b"y"}) == [expected]
    for number in range(1000, 2000):  # as often as it likes
        conversation.accept(
            json.dumps({"op": "subscribe", "subscriptions": [{"id": number, "channelId": 1}]})
        )
    assert len(conversation.written(5, {1: b"x", 2: b"y"})) == 2
    conversation.accept('{"op": "unsubscribe", "subscriptionIds": [300]}')
    assert len(conversation.written(5, {1: b"x", 2: b"y"})) == 1
