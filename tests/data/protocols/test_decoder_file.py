"""One's own decoder out of a file: loaded, or refused with what is wrong and where."""

from __future__ import annotations

from pathlib import Path

import pytest

from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.decoder import Decoder, DecoderError

TEXT = """\
import numpy as np
from lab.data.protocols.samples import FIX, IMU, Samples


class Doubled:
    def __init__(self):
        self.rest = b""

    def feed(self, data):
        data = self.rest + data
        whole = len(data) // 3 * 3
        self.rest = data[whole:]
        imu = np.zeros(whole // 3, IMU)
        imu["rate"] = np.frombuffer(data[:whole], np.uint8).reshape(-1, 3)
        return Samples(imu, np.zeros(0, FIX))


class Wrong(Doubled):
    def feed(self, data):
        return np.zeros((2, 3)), []


class Flat(Doubled):
    def feed(self, data):
        return np.zeros(2), np.zeros(0, FIX)


class Failing(Doubled):
    def feed(self, data):
        return data[10_000]


number = 3
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    path = tmp_path / "mine.py"
    path.write_text(TEXT)
    return path


def test_a_class_with_feed_alone_is_a_decoder(file: Path) -> None:
    decoder = make_decoder(f"{file}:Doubled")
    assert isinstance(decoder, Decoder)
    assert decoder.name == "Doubled"
    assert decoder.feed(b"\1\2\3\4").imu["rate"].tolist() == [[1, 2, 3]]
    assert decoder.feed(b"\5\6").imu["rate"].tolist() == [[4, 5, 6]]
    assert len(decoder.finish().imu) == 0
    assert (decoder.statistics.bytes, decoder.statistics.frames) == (6, 2)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nothing", "'nothing' is no protocol; accepted are vectornav, xsens"),
        ("mine.txt:Doubled", r"accepted is FILE.py:Name, such as my_sensor.py:MyDecoder"),
        ("mine.py:Nobody", "has no 'Nobody'; decoders in the file: Doubled, Failing, Flat, Wrong"),
        ("mine.py:number", r"of type int, without a method feed\(data\)"),
        ("nowhere.py:Doubled", "there is no such file"),
    ],
)
def test_what_cannot_be_loaded_is_named(
    file: Path, monkeypatch: pytest.MonkeyPatch, name: str, words: str
) -> None:
    monkeypatch.chdir(file.parent)
    with pytest.raises(DecoderError, match=words):
        make_decoder(name)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Wrong", r"Wrong: feed returned an array \(2, 3\) of float64; accepted is Samples\(imu, fix\)"),
        ("Flat", r"Flat: feed returned an array \(2,\) of float64; accepted is Samples\(imu, fix\)"),
        ("Failing", "failed by itself: mine.py, line 30, in feed: IndexError"),
    ],
)
def test_what_fails_says_where(file: Path, name: str, words: str) -> None:
    with pytest.raises(DecoderError, match=words):
        make_decoder(f"{file}:{name}").feed(b"abc")
