"""UBX: captured messages have the values that pyubx2 and gpsd read in them."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest
from live_streams import capture, decoded, fixes, motion

from lab.data.protocols.catalogue import decoder_of
from lab.data.protocols.stream_decoder import StreamDecoder
from lab.data.protocols.ubx import MEAS_TICK, RAW_TICK, Ubx
from lab.data.protocols.ubx_encoder import UbloxEncoder

pyubx2 = pytest.importorskip("pyubx2")

M8U, F9P = "ubx_gpsd_neo-m8u.log", "ubx_gpsd_zed-f9p-hp.log"
WALK = "ubx_gnss_imu_walk_1730_head256k.ubx"


def messages(data: bytes, name: str) -> list:
    """Return the messages of a name that pyubx2 reads."""
    reader = pyubx2.UBXReader(io.BytesIO(data), protfilter=2, quitonerror=0)
    return [message for _, message in reader if message is not None and message.identity == name]


@pytest.mark.parametrize(("name", "count"), [(M8U, 3), (F9P, 29), (WALK, 89)])
def test_captured_fixes_have_the_values_of_pyubx2(name, count):
    data = capture(name)
    decoder = StreamDecoder("ublox", (Ubx(),))
    rows, expected = decoded(decoder, data).fix, messages(data, "NAV-PVT")
    assert len(rows) == len(expected) == count
    assert decoder.statistics.failed == 0
    for row, message in zip(rows, expected, strict=True):
        assert np.degrees([row["latitude"], row["longitude"]]) == pytest.approx(
            (message.lat, message.lon), abs=1e-12
        )
        assert row["height"] == pytest.approx(message.height * 1e-3, abs=1e-12)
        speeds = [message.velN, message.velE, message.velD]
        assert row["velocity_n"] == pytest.approx([speed * 1e-3 for speed in speeds], abs=1e-12)
        sigma = [row["horizontal_sigma"], row["vertical_sigma"], row["speed_sigma"]]
        assert sigma == pytest.approx([1e-3 * message.hAcc, 1e-3 * message.vAcc, 1e-3 * message.sAcc])
        assert row["satellites"] == message.numSV
        carrier = {0: 4 if message.diffSoln else 3, 1: 5, 2: 6}[message.carrSoln]
        assert row["fix_type"] == carrier
        clock = message.hour * 3600 + message.min * 60 + message.second + message.nano * 1e-9
        assert row["utc"] % 86400 == pytest.approx(clock % 86400, abs=1e-6)


def test_the_first_fix_has_the_numbers_that_were_noted():
    row = decoded(decoder_of("ublox"), capture(F9P)).fix[0]
    assert row["week_time"] == pytest.approx(163178.0)
    assert np.degrees([row["longitude"], row["latitude"]]) * 1e7 == pytest.approx(
        (1705001306, -458775286), abs=1e-4
    )
    assert (row["height"], row["satellites"], row["fix_type"]) == (pytest.approx(29.234), 16, 3)
    assert row["velocity_n"] == pytest.approx((0.251, -0.039, -0.024))
    times = decoded(decoder_of("ublox"), capture(WALK)).fix["week_time"]
    assert times[[0, -1]] == pytest.approx((408639.75, 408661.75))
    np.testing.assert_allclose(np.diff(times), 0.25, atol=1e-9)


def gpsd(message: str) -> dict[int, dict[str, float]]:
    """Return the lines of gpsd for a message, by their time tag; it repeats lines."""
    lines = map(
        json.loads,
        filter(
            lambda line: f'"UBX-{message}"' in line,
            capture("ubx_gpsd_neo-m8u.expected.jsonl").decode().splitlines(),
        ),
    )
    return {line["timeTag"]: line for line in lines}


@pytest.mark.parametrize(
    ("message", "imu", "tick", "count"),
    [("ESF-RAW", "raw", RAW_TICK, 290), ("ESF-MEAS", "meas", MEAS_TICK, 58)],
)
def test_captured_samples_have_the_values_of_gpsd(message, imu, tick, count):
    expected = gpsd(message)
    rows = decoded(StreamDecoder("ublox", (Ubx(imu),)), capture(M8U)).imu
    assert len(rows) == count
    compared = 0
    for row in rows:
        line = expected.get(round(row["time"] / tick))
        if line is None:
            continue
        compared += 1
        if "acc_x" in line:
            assert row["force"] == pytest.approx([line[f"acc_{axis}"] for axis in "xyz"], abs=5.1e-6)
        if "gyro_x" in line:
            assert np.degrees(row["rate"]) == pytest.approx(
                [line[f"gyro_{axis}"] for axis in "xyz"], abs=5.1e-6
            )
            assert row["temperature"] == pytest.approx(line["gyro_temp"])
    assert compared >= 0.98 * len(expected)
    assert compared >= 0.9 * count


def test_all_samples_have_the_numbers_of_pyubx2():
    data = capture(M8U)
    rows = iter(decoded(StreamDecoder("ublox", (Ubx("raw"),)), data).imu)
    units = {
        14: ("rate", 0),
        13: ("rate", 1),
        5: ("rate", 2),
        16: ("force", 0),
        17: ("force", 1),
        18: ("force", 2),
    }
    for message in messages(data, "ESF-RAW"):
        words = [getattr(message, f"data_{number:02d}") for number in range(1, 71)]
        for begin in range(0, 70, 7):
            row = next(rows)
            for word in words[begin : begin + 7]:
                if word[3] in units:
                    name, axis = units[word[3]]
                    value = int.from_bytes(word[:3], "little", signed=True)
                    unit = math.radians(2**-12) if name == "rate" else 2**-10
                    assert row[name][axis] == pytest.approx(value * unit, rel=1e-12)
    assert next(rows, None) is None


def test_the_faster_message_of_the_imu_goes_before_the_slower_one():
    rows = decoded(decoder_of("ublox"), capture(M8U)).imu
    assert len(rows) == 290
    assert not np.isnan(rows["rate"]).any()
    np.testing.assert_allclose(np.diff(rows["time"]), 0.01, atol=1.1e-3)  # its tags jitter by 1 ms


def test_sentences_beside_messages_make_no_second_fix():
    data = capture(WALK)
    assert len(decoded(decoder_of("nmea"), data).fix) == 88
    assert len(decoded(decoder_of("ublox"), data).fix) == 89


def test_without_a_fix_the_position_is_unknown():
    fix = fixes(2)
    fix["fix_type"] = 1
    found = decoded(decoder_of("ublox"), UbloxEncoder().encode(fix[:0], fix)).fix
    assert (found["fix_type"] == 1).all()
    assert np.isnan(found["latitude"]).all()
    assert np.isnan(found["velocity_n"]).all()


@pytest.mark.parametrize("imu", ["raw", "meas"])
def test_what_is_encoded_is_read_by_us_and_by_pyubx2(imu):
    samples, fix = motion(500), fixes(5)
    data = UbloxEncoder(imu).encode(samples, fix)
    found = decoded(decoder_of("ublox"), data)
    rows = found.imu if imu == "raw" else found.imu[1::2]
    forces = found.imu if imu == "raw" else found.imu[::2]
    np.testing.assert_allclose(rows["rate"], samples["rate"], atol=math.radians(2**-13) + 1e-12)
    np.testing.assert_allclose(forces["force"], samples["force"], atol=2**-11 + 1e-12)
    np.testing.assert_allclose(rows["time"], samples["time"], atol=(RAW_TICK if imu == "raw" else MEAS_TICK))
    for name in ("latitude", "longitude"):
        np.testing.assert_allclose(found.fix[name], fix[name], atol=1e-9)
    read = messages(data, "NAV-PVT")
    assert [message.velE for message in read] == [8500] * 5
    assert [message.numMeas if imu == "meas" else 0 for message in messages(data, "ESF-MEAS")] == [
        3,
        4,
    ] * 500 * (imu == "meas")


def test_the_tags_go_on_when_they_start_again():
    samples = motion(300)
    samples["time"] += 655.36 - 8.5
    found = decoded(decoder_of("ublox"), UbloxEncoder().encode(samples, fixes(0))).imu
    np.testing.assert_allclose(np.diff(found["time"]), 0.01, atol=2 * RAW_TICK)
