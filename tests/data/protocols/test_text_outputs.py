"""Texts that people own: each has the values that were printed, live and from a file, however it is cut."""

from __future__ import annotations

import re

import numpy as np
import pytest
from live_streams import decoded
from text_outputs import COUNT, OUTPUTS, Printed, numbers

from lab.base.files.mission_error import MissionError
from lab.data.files.unit_names import UNITS
from lab.data.formats import log_reader_of
from lab.data.protocols.column_map import UNITS_OF, ColumnMap
from lab.data.protocols.recognition import recognise
from lab.data.protocols.text_lines import TextLines
from lab.data.sheets.sensor_csv import sheets_of
from lab.data.sheets.sheet_imu import triads
from lab.data.streams.capture import holds_samples
from lab.data.streams.reception import Reception
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.transport import Chunk

COUNTS = ("i2cdevlib_raw", "raw_on_two_lines")


def check(imu: np.ndarray, printed: Printed) -> None:
    """Check that rows have the values that were printed; the first line of a stream may be left out."""
    count = len(imu)
    assert COUNT - 2 <= count <= COUNT
    np.testing.assert_allclose(imu["force"], printed.force[-count:], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(imu["rate"], printed.rate[-count:], rtol=1e-12, atol=1e-12)
    if printed.magnetic is not None:
        np.testing.assert_allclose(imu["magnetic"], printed.magnetic[-count:], rtol=1e-12, atol=1e-15)
    if printed.time is None:
        assert np.isnan(imu["time"]).all()
    else:  # nanoseconds since 1970 have a resolution of 0.2 µs as numbers
        np.testing.assert_allclose(imu["time"], printed.time[-count:], atol=2e-6)


@pytest.mark.parametrize("name", OUTPUTS)
def test_a_text_has_the_values_that_were_printed(name):
    printed = OUTPUTS[name]()
    data = printed.text.encode()
    (found,) = (one for one in recognise(data) if one.name == "text")
    assert found.columns is not None
    check(decoded(TextLines(), data).imu, printed)


@pytest.mark.parametrize("name", OUTPUTS)
def test_any_cut_of_the_bytes_gives_the_same_rows(name):
    data = OUTPUTS[name]().text.encode()
    whole = decoded(TextLines(), data).imu
    rng = np.random.default_rng(7)
    for cuts in ([1] * len(data), rng.integers(1, 90, len(data)).tolist()):
        decoder, at, parts = TextLines(), 0, []
        for size in cuts:
            parts.append(decoder.feed(data[at : at + size]).imu)
            at += size
        parts.append(decoder.finish().imu)
        assert np.concatenate(parts).tobytes() == whole.tobytes()


@pytest.mark.parametrize("name", OUTPUTS)
def test_columns_that_are_written_down_read_the_same_lines(name):
    data = OUTPUTS[name]().text.encode()
    decoder = TextLines()
    whole = decoded(decoder, data).imu
    assert decoder.columns is not None
    again = TextLines(ColumnMap.of(str(decoder.columns)))
    assert decoded(again, data).imu.tobytes() == whole.tobytes()


@pytest.mark.parametrize("name", OUTPUTS)
def test_a_stream_that_is_joined_between_two_lines_has_the_values_too(name):
    """Where nothing shows with which line a sample begins, force goes before rate, as in all of these."""
    printed = OUTPUTS[name]()
    data = printed.text.encode()
    begin = int(0.37 * len(data))
    decoder = TextLines()
    imu = decoded(decoder, data[begin:]).imu
    if name in ("movella_dot", "mt_manager", "artemis", "lp_research", "rostopic", "witmotion_text"):
        return  # their header is not repeated
    count = len(imu)
    assert count > COUNT // 2
    np.testing.assert_allclose(imu["force"], printed.force[-count:], rtol=1e-12)
    assert decoder.columns is not None
    if not decoder.columns.doubt:  # the first lines may be too slow to show the unit
        np.testing.assert_allclose(imu["rate"], printed.rate[-count:], rtol=1e-12)


@pytest.mark.parametrize("name", [name for name, make in OUTPUTS.items() if "\n" in make().text[:-1]])
def test_a_lost_line_costs_its_own_sample_only(name):
    printed = OUTPUTS[name]()
    lines = printed.text.splitlines(keepends=True)
    rng = np.random.default_rng(11)
    lost = sorted(rng.choice(np.arange(len(lines) // 2, len(lines)), 5, replace=False), reverse=True)
    for at in lost:
        del lines[at]
    imu = decoded(TextLines(), "".join(lines).encode()).imu
    assert len(imu) >= COUNT - 7
    known = np.hstack((printed.force, printed.rate))
    found = np.hstack((imu["force"], imu["rate"]))
    assert np.abs(found[:, None] - known).max(axis=2).min(axis=1).max() < 1e-9


def test_slow_devices_are_recognised_after_four_samples_despite_what_they_say_first():
    """Adafruit's sketch prints two samples a second, after 200 bytes about itself."""
    text = OUTPUTS["adafruit_mpu6050"]().text
    reception, came = Reception(), 0
    head, *samples = text.split("Acceleration X")
    reception.accept(Chunk(0.0, head.encode()))
    for number, sample in enumerate(samples[:8]):
        came += len(reception.accept(Chunk(0.5 * number, f"Acceleration X{sample}".encode()))[0])
    assert reception.detector.protocol == "text"


def with_positions() -> tuple[str, np.ndarray]:
    """Return lines with a position in each fifth, and the positions [°], [m]."""
    printed = OUTPUTS["arduino_plotter"]()
    number = np.arange(COUNT // 5)
    places = np.column_stack((-45.9 + 1e-5 * number, 170.5 - 2e-5 * number, 29.25 + number))
    lines = [
        f"t:{20 * number},lat:{places[number // 5][0]:.7f},lon:{places[number // 5][1]:.7f},"
        f"alt:{places[number // 5][2]:.2f},{line}"
        for number, line in enumerate(printed.text.splitlines())
    ]
    lines[:5] = [re.sub(r"lat:.*?,ax", "lat:0.0,lon:0.0,alt:0.0,ax", line) for line in lines[:5]]
    return "\n".join(lines) + "\n", places


def test_a_position_that_changes_is_a_fix_of_its_line():
    text, places = with_positions()
    samples = decoded(TextLines(), text.encode())
    check(samples.imu, OUTPUTS["arduino_plotter"]()._replace(time=0.02 * np.arange(COUNT)))
    np.testing.assert_allclose(np.degrees(samples.fix["latitude"]), places[1:, 0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(samples.fix["longitude"]), places[1:, 1], atol=1e-9)
    np.testing.assert_allclose(samples.fix["height"], places[1:, 2])
    np.testing.assert_allclose(samples.fix["time"], 0.1 * np.arange(1, len(places)), atol=1e-12)
    assert (samples.fix["sea_level"] == 1).all()


@pytest.mark.parametrize("name", OUTPUTS)
def test_a_saved_file_has_the_values_of_the_stream(name, tmp_path):
    """Files without times are read at the rate that a person gives; those with headings by the csv reader."""
    printed = OUTPUTS[name]()
    path = tmp_path / f"{name}.txt"
    path.write_text(printed.text, newline="")
    options = {} if printed.time is not None else {"rate": "50"}
    streamed = recorded_samples(path, **options).imu
    live = decoded(TextLines(), printed.text.encode()).imu
    count = len(streamed)
    assert count >= COUNT - 2
    np.testing.assert_array_equal(streamed["rate"], live["rate"][-count:])
    np.testing.assert_array_equal(streamed["force"], live["force"][-count:])
    try:
        reader = log_reader_of(path)
    except MissionError:
        assert holds_samples(path)  # the import takes it for the bytes of a device
        return
    assert reader.read_logs is not None
    sheets = sheets_of([path], {})
    unit = "°/s" if "°/s" in str(recognise(printed.text.encode())[0].columns) else "rad/s"
    (gyro, *_), (force, *_) = triads(sheets, "rate"), triads(sheets, "force")
    rates = gyro.values[-50:] * UNITS["angular rate"][gyro.unit or unit]
    forces = force.values[-50:] * UNITS["acceleration"][force.unit or ("mg" if name == "artemis" else "m/s²")]
    np.testing.assert_allclose(rates, printed.rate[-50:], rtol=1e-12)
    np.testing.assert_allclose(forces, printed.force[-50:], rtol=1e-12)


@pytest.mark.parametrize(
    ("form", "force", "rate"),
    [
        ("IMU: ax={:.2f} ay={:.2f} az={:.2f} gx={:.2f} gy={:.2f} gz={:.2f}\n", "m/s²", "rad/s"),
        ("acc:{:.2f},{:.2f},{:.2f} gyr:{:.2f},{:.2f},{:.2f}\n", "g", "°/s"),
        ("Acc: ({:.2f}, {:.2f}, {:.2f}) Gyro: ({:.2f}, {:.2f}, {:.2f})\n", "m/s²", "rad/s"),
        ("Acceleration: X:{:.2f}, Y: {:.2f}, Z: {:.2f} m/s^2\nGyro X:{:.2f}, Y: {:.2f}, Z: {:.2f} rad/s\n\n",
         "m/s²", "rad/s"),
        ("===\ntemp : 25\naccX : {:.2f}\taccY : {:.2f}\taccZ : {:.2f}\n"
         "gyroX : {:.2f}\tgyroY : {:.2f}\tgyroZ : {:.2f}\n===\n\n", "g", "°/s"),
        ("Accelerometer data: \n{:.2f}\t{:.2f}\t{:.2f}\n\nGyroscope data: \n{:.2f}\t{:.2f}\t{:.2f}\n\n",
         "g", "°/s"),
        ("A: {:6.0f} {:6.0f} {:6.0f}    G: {:6.0f} {:6.0f} {:6.0f}\n", "g/16384", "°/s/131"),
        ("AcX = {:.0f} | AcY = {:.0f} | AcZ = {:.0f} | Tmp = 26.01 | GyX = {:.0f} | GyY = {:.0f} | "
         "GyZ = {:.0f}\n", "g/16384", "°/s/131"),
        ("{{'AcX': {:.0f}, 'AcY': {:.0f}, 'AcZ': {:.0f}, 'Tmp': -2880, 'GyX': {:.0f}, 'GyY': {:.0f}, "
         "'GyZ': {:.0f}}}\n", "g/16384", "°/s/131"),
        ("AccX: {:.2f}\nAccY: {:.2f}\nAccZ: {:.2f}\nGyroX: {:.2f}\nGyroY: {:.2f}\nGyroZ: {:.2f}\n",
         "m/s²", "rad/s"),
        ("Accel X={:.2f}g Y={:.2f}g Z={:.2f}g  Gyro X={:.2f}dps Y={:.2f}dps Z={:.2f}dps\n", "g", "°/s"),
    ],
)  # fmt: skip
def test_other_forms_of_the_same_kinds(form, force, rate):
    """A sample on each line or block, of a device that is turned by hand: the last block may not be whole."""
    units = UNITS_OF["force"][force], UNITS_OF["rate"][rate]
    decimals = 0 if "/1" in force else 2
    forces, rates = numbers(31, 9.80665 / units[0], 1 / units[1], decimals)
    text = "".join(form.format(*a, *b) for a, b in zip(forces, rates, strict=True))
    imu = decoded(TextLines(), text.encode()).imu
    count = len(imu)
    assert count >= COUNT - 1
    np.testing.assert_allclose(imu["force"], (forces * units[0])[-count:], rtol=1e-12)
    np.testing.assert_allclose(imu["rate"], (rates * units[1])[-count:], rtol=1e-12)
