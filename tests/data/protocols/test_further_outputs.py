"""Further texts that people own: values, units, clock, live and from a file; what is no IMU is none."""

from __future__ import annotations

import numpy as np
import pytest
from further_outputs import COUNT, FORMS, NOTHING, RATE, Form, checked, motion, printed

from lab.data.protocols.recognition import recognise, sound_frames
from lab.data.protocols.text_lines import TextLines
from lab.data.streams.reception import Reception
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.transport import Chunk

NAMED = (
    "teleplot_with_times", "motioncal_raw", "motioncal", "razor_sensors", "smbus", "circuitpython",
    "ros2_csv", "zephyr_lsm6dsl", "zephyr_mpu6050", "px4_listener", "bmi270", "um7", "units_in_cells",
)  # fmt: skip
"""Texts that say the unit of their rates: nothing is asked."""


def received(text: str, seed: int = 1) -> tuple[np.ndarray, Reception, bool]:
    """Return the samples of a text that comes in pieces, its reception, and whether a unit was asked."""
    data, rng, at = text.encode(), np.random.default_rng(seed), 0
    reception, parts, asked = Reception(), [], False
    lines = np.cumsum([len(line) for line in data.splitlines(keepends=True)])
    times = np.arange(1, len(lines) + 1) * COUNT / RATE / len(lines)
    while at < len(data):
        size = int(rng.integers(1, 200))
        samples, _ = reception.accept(Chunk(float(np.interp(at + size, lines, times)), data[at : at + size]))
        at += size
        factor = reception.taken_factor()  # for those before
        for part in parts if factor != 1 else []:
            part["rate"] *= factor
        parts.append(samples)
        asked |= bool(reception.doubt)
    return np.concatenate(parts), reception, asked


@pytest.mark.parametrize("name", FORMS)
def test_a_stream_has_the_values_that_were_printed(name):
    form = FORMS[name]
    text, force, rate = printed(form, seed=3)
    imu, reception, asked = received(text)
    count = len(imu)
    assert COUNT - 4 <= count <= COUNT
    # The last line waits for what follows it.
    end = COUNT if np.allclose(imu["force"][-1], force[-1]) else COUNT - 1
    np.testing.assert_allclose(imu["force"], force[end - count : end], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(imu["rate"], rate[end - count : end], rtol=1e-9, atol=1e-9)
    assert asked == (name not in NAMED)
    assert not asked or "first turn" in reception.decided
    if np.isfinite(form.begin):
        np.testing.assert_allclose(np.diff(imu["time"]), 1 / RATE, atol=2e-4)
    else:
        assert "by the number of samples" in reception.imu.timing


@pytest.mark.parametrize("name", FORMS)
def test_a_saved_text_has_the_values_that_were_printed(name, tmp_path):
    form = FORMS[name]
    text, force, rate = printed(form, seed=4)
    path = tmp_path / f"{name}.txt"
    path.write_text(text, newline="")
    imu = recorded_samples(path, **({} if np.isfinite(form.begin) else {"rate": "50"})).imu
    count = len(imu)
    assert COUNT - 1 <= count <= COUNT
    np.testing.assert_allclose(imu["force"], force[-count:], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(imu["rate"], rate[-count:], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", NOTHING)
def test_angles_and_quaternions_are_no_imu_and_their_lines_are_shown(name):
    assert not recognise(NOTHING[name].encode()[:16_000])
    imu, reception, _ = received(NOTHING[name])
    assert not len(imu)
    assert not reception.detector.protocol
    assert (
        reception.detector.last_lines == tuple(NOTHING[name].splitlines()[-4:-1])
        or len(reception.detector.last_lines) == 3
    )
    assert "recognised in" in reception.described


def test_a_time_belongs_to_the_sample_that_it_stands_in():
    """Its line may be the first or, where brackets hold a sample together, the last."""
    for name in ("zephyr_mpu6050", "airsim", "gazebo", "jy901"):
        form = FORMS[name]
        text, force, _ = printed(form)
        decoder = TextLines()
        imu = decoder.feed(text.encode()).imu
        first = COUNT - len(imu) - (not np.allclose(imu["force"][-1], force[-1]))
        begin = (
            imu["time"][0] - np.round(imu["time"][0] - form.begin, -1) if name == "jy901" else imu["time"][0]
        )
        np.testing.assert_allclose(np.diff(imu["time"]), 1 / RATE, atol=1e-5)
        np.testing.assert_allclose(imu["force"], force[first : first + len(imu)], rtol=1e-9)
        if name != "jy901":
            np.testing.assert_allclose(begin, form.begin + first / RATE, atol=1e-5)


def test_positions_in_radians_are_those_of_the_land():
    """In degrees they would be in the sea off Africa; near 0°, 0° they stay in degrees, as of simulators."""
    form = Form("lat={n} lon={n}9 ax={f[0]} ay={f[1]} az={f[2]} gx={w[0]} gy={w[1]} gz={w[2]}\n", "m", "rad")
    text, _, _ = printed(form)
    lines = text.splitlines()
    for start, unit in (((0.8255, 0.1483), 1.0), ((0.01, 0.02), np.pi / 180)):
        placed = [
            line.replace(f"lat={n} lon={n}9", f"lat={start[0] + 1e-7 * n:.9f} lon={start[1]:.9f}")
            for n, line in enumerate(lines)
        ]
        decoder = TextLines()
        fix = decoder.feed("\n".join(placed).encode()).fix
        np.testing.assert_allclose(fix["latitude"][0], unit * start[0], atol=1e-5)
        np.testing.assert_allclose(fix["longitude"], unit * start[1], atol=1e-9)


def test_bytes_that_are_printed_as_hexadecimal_numbers_are_named():
    _, force, rate = motion(0)
    data = b""
    for a, b in zip(force, rate, strict=True):
        for kind, values, scale in ((0x51, a, 32768 / (16 * 9.80665)), (0x52, b, 32768 / np.radians(2000))):
            frame = bytes((0x55, kind)) + np.round(values * scale).astype("<i2").tobytes() + b"\xc4\x09"
            data += frame + bytes((sum(frame) & 255,))
    rows = [data[at : at + 16] for at in range(0, len(data), 16)]
    for text in (
        "\n".join(row.hex(" ").upper() for row in rows),
        "\n".join(f"{16 * n:08x}: {row.hex()[:4]} {row.hex()[4:]}  U.R....." for n, row in enumerate(rows)),
        "\n".join(", ".join(f"0x{byte:02x}" for byte in row) + "," for row in rows),
    ):
        found = sound_frames(text.encode())
        assert found.startswith("These are bytes printed as hexadecimal numbers. Recognised as WitMotion")
    assert not sound_frames(b"12 34 56 78\n" * 5000)


def test_a_line_with_a_wrong_check_is_not_read():
    text, force, _ = printed(FORMS["quectel"])
    lines = text.splitlines(keepends=True)
    lines[100] = (
        lines[100].replace(",9.8", ",8.8", 1)
        if ",9.8" in lines[100]
        else lines[100][:12] + "1" + lines[100][13:]
    )
    decoder = TextLines()
    imu = decoder.feed("".join(lines).encode()).imu
    assert len(imu) == COUNT - 1
    np.testing.assert_allclose(imu["force"], np.delete(force, 100, axis=0), rtol=1e-9)


@pytest.mark.parametrize(
    "sentences",
    [
        (
            "GPGSV,3,1,11,03,03,111,00,04,15,270,00,06,01,010,00,13,06,292,00",
            "GNGSA,A,1,,,,,,,,,,,,,9.9,9.9,9.9",
        ),
        ("PUBX,04,1020{n:02}.00,230324,3000{n:02}.00,2304,15D,-2660664,-43.912,21",),
    ],
)
def test_sentences_of_a_receiver_are_no_imu(sentences):
    """They have checks and many numbers; only lines whose name says that they are of an IMU are read so."""
    lines = [f"${one.format(n=n)}*hh" for n in range(59) for one in sentences]
    assert not recognise(checked("\n".join(lines)).encode())
