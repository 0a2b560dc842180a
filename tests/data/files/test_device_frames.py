"""Files of binary frames that no reader reads: the refusal says whose frames they are, and what to do."""

from __future__ import annotations

import numpy as np
import pytest

from lab.data.formats import advice_on_frames, reader_of
from lab.missions import MissionError


@pytest.mark.parametrize(
    ("mark", "device", "advice"),
    [
        (b"\xfa\xff\x36\x50", "an IMU of Xsens", "ins-lab import FILE --as log"),
        (b"\xfa\xff\x32\x50", "an IMU of Xsens, in its older format MTData", "Convert them"),
        (b"ue\x80\x2a", "an IMU of MicroStrain", "ins-lab import FILE --as log"),
        (b"\xfa\x01\x29\x01", "an IMU of VectorNav", "ins-lab import FILE --as log"),
        (b"\xaaD\x12\x1c", "a NovAtel receiver", "ins-lab import FILE --as log"),
        (b"$@\x12\x34", "a Septentrio receiver", "ins-lab import FILE --as log"),
        (b"\xb0\xb3\xa0\xa2\x00\x5b", "a SiRF receiver", "Convert them"),
        (b"\r\n\xa0\xa1\x00\x3b", "a SkyTraq receiver", "Convert them"),
    ],
)
def test_the_refusal_names_the_device(tmp_path, mark, device, advice):
    random = np.random.default_rng(3)
    path = tmp_path / "capture.bin"
    path.write_bytes(b"".join(mark + random.bytes(80) for _ in range(40)))
    with pytest.raises(MissionError, match=rf"binary frames of {device}\. {advice} .* Accepted"):
        reader_of(path)


def test_other_bytes_are_of_no_device():
    assert not advice_on_frames(np.random.default_rng(3).bytes(2**16))
    assert not advice_on_frames(b"a value of $@ blue@ or ue\x80\n" * 3 + bytes(4000))
