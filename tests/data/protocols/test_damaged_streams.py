"""Streams: the pieces in which bytes come do not matter; nothing that comes raises or fills the memory."""

from __future__ import annotations

import math
import tracemalloc
import zlib

import numpy as np
import pytest
from fuzz.mutations import mutated
from fuzz.streams import attack_decoder, same, seed, unchecked
from hypothesis import given
from hypothesis import strategies as st
from live_streams import capture, decoded, fixes, motion

from lab.data.protocols.catalogue import DECODERS, ENCODERS, make_decoder
from lab.data.protocols.decoder import Decoder, Encoder
from lab.data.protocols.device_time import WrappingCounter
from lab.data.protocols.limits import LimitCheck, Limits

CAPTURES = {
    "vectornav": "vn100_bin_waves_F00294.bin",
    "xsens": "xsens_mti_einride_1.bin",
    "mip": "mip_sdk_mip_data.bin",
    "ublox": "ubx_gpsd_neo-m8u.log",
    "nmea": "ubx_gnss_imu_walk_1730_head256k.ubx",
    "mavlink": "mavlink_blueos_head400k.tlog",
    "text": "csv_gnss_imu_walk_1730_head6000.csv",
}


STARTS = {
    "vectornav": b"\xfa",
    "xsens": b"\xfa\xff\x36",
    "mip": b"ue\x80",
    "memsense": b"\xff\xff\xff\xff&\xff\x14",
    "ublox": b"\xb5b",
    "nmea": b"$GPGGA,",
    "mavlink": b"\xfd",
    "novatel": b"#BESTPOSA,",
    "septentrio": b"$@",
    "witmotion": b"\x55\x52",
    "bno085": b"\xaa\xaa",
    "phone": b'{"phone":1,"check":"',
    "text": b"\n1,2,",
}
"""How frames begin."""


@pytest.mark.parametrize("name", DECODERS)
def test_decoders_and_encoders_are_what_they_promise_to_be(name):
    assert isinstance(make_decoder(name), Decoder)
    assert isinstance(ENCODERS[name](), Encoder)
    assert make_decoder(name).name == ENCODERS[name]().name == name


@pytest.mark.proof
@pytest.mark.parametrize("name", DECODERS)
def test_bytes_one_by_one_give_what_all_at_once_give(name):
    data = seed(name)
    whole = decoded(make_decoder(name), data)
    assert len(whole.imu) + len(whole.fix) >= 4
    for step in (1, 7, 64):
        assert same(decoded(make_decoder(name), data, step), whole)


@pytest.mark.proof
@pytest.mark.parametrize("name", CAPTURES)
def test_pieces_of_a_capture_give_what_all_of_it_gives(name):
    data = capture(CAPTURES[name])[:60_000]
    whole = decoded(make_decoder(name), data)
    for step in (1, 100, 4096):
        assert same(decoded(make_decoder(name), data, step), whole)


@pytest.mark.proof
@pytest.mark.parametrize("name", DECODERS)
def test_damaged_content_that_passes_its_check_raises_nothing(name):
    rng = np.random.default_rng(zlib.crc32(name.encode()) + 1)
    data = seed(name, 30)
    with unchecked():
        for _ in range(60):
            hostile = mutated(data, rng)
            found = attack_decoder(name, hostile, int(rng.integers(1, 500)))
            assert same(found, attack_decoder(name, hostile, max(len(hostile), 1)))


@pytest.mark.proof
@pytest.mark.parametrize("name", DECODERS)
def test_hostile_streams_raise_nothing(name):
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    data = seed(name, 60)
    kept = 0
    for _ in range(60):
        hostile = mutated(data, rng)
        found = attack_decoder(name, hostile, int(rng.integers(1, 500)))
        assert same(found, attack_decoder(name, hostile, max(len(hostile), 1)))
        kept += len(found.imu) + len(found.fix)
    assert kept > 60  # attacks that leave nothing would test nothing else


@pytest.mark.parametrize("name", DECODERS)
@given(data=st.binary(max_size=600), step=st.integers(1, 50), head=st.booleans())
def test_bytes_at_random_raise_nothing(name, data, step, head):
    attack_decoder(name, STARTS[name] + data if head else data, step)


@pytest.mark.proof
@pytest.mark.parametrize("name", DECODERS)
@pytest.mark.parametrize("kind", ["random", "starts", "repeated"])
def test_memory_is_bounded_whatever_comes(name, kind):
    data = {
        "random": lambda: np.random.default_rng(1).bytes(200_000),
        "starts": lambda: seed(name, 2)[:7] * 25_000,
        "repeated": lambda: seed(name, 2) * 6000,
    }[kind]()[:200_000]
    decoder = make_decoder(name)
    tracemalloc.start()
    try:
        for at in range(0, len(data), 4096):
            decoder.feed(data[at : at + 4096])
        held, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        decoder.feed(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 500_000
    assert peak - held < 10 * len(data)


@pytest.mark.parametrize(
    ("name", "head"),
    [
        ("ublox", "b5620107ffff"),
        ("xsens", "faff36ffffff"),
        ("mip", "756580ff"),
        ("vectornav", "fa7fff7f"),
        ("nmea", "24"),
        ("text", "0a31"),
    ],
)
def test_a_frame_that_claims_to_be_long_is_not_waited_for(name, head):
    decoder = make_decoder(name)
    decoder.feed(bytes.fromhex(head))
    for _ in range(1200):
        decoder.feed(b"1" * 64)
        assert decoder.held <= decoder.longest
    assert decoder.held < 4096


def test_samples_beyond_the_limits_are_refused_and_counted():
    imu = motion(10)
    imu["force"][3] = 1e30
    imu["rate"][5] = np.nan, 0.1, 0.2
    decoder = make_decoder("xsens")
    data = ENCODERS["xsens"]().encode(imu, fixes(0))
    found = decoded(decoder, data).imu
    assert len(found) == 9  # of the rate that is half NaN the encoder sends nothing
    assert decoder.statistics.refused == 1
    assert decoder.statistics.frames == 10


def test_limits():
    check = LimitCheck(Limits(rate=10, force=100, rate_step=1, force_step=10))
    still = (0.0, 0.0, 0.0)
    assert check.accepts(still, still)
    assert not check.accepts((11.0, 0, 0), still)
    assert not check.accepts(still, (0, 0, 101.0))
    assert not check.accepts((2.0, 0, 0), still)  # alone
    assert check.accepts((0.5, 0, 0), still)
    assert not check.accepts(still, (0, 0, 50.0))
    assert check.accepts(still, (0, 0, 49.0))  # confirmed
    assert not check.accepts((math.inf, 0, 0), still)
    assert not check.accepts((math.nan, 0, 0), still)
    unknown = (math.nan,) * 3
    assert check.accepts(unknown, (0, 0, 48.0))


@given(st.lists(st.integers(-30_000, 30_000), max_size=30), st.integers(0, 65_535))
def test_counters_go_on(steps, start):
    counter = WrappingCounter(65_536)
    value = counter.continued(start)
    true = start
    for step in steps:
        true += step
        value = counter.continued(true % 65_536)
    assert value == true
