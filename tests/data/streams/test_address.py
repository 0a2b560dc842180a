"""Address: what names a source, and what does not."""

from __future__ import annotations

import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.data.streams.address import KINDS, Address, computer_and_port
from lab.data.streams.transport import TransportError
from lab.live import open as open_source


def test_an_address_is_taken_apart() -> None:
    address = Address.of("serial:/dev/serial/by-id/usb-FTDI?baud=921600&axes=y,x,-z&name=my%20car")
    assert (address.kind, address.place) == ("serial", "/dev/serial/by-id/usb-FTDI")
    assert address.options == {"baud": "921600", "axes": "y,x,-z", "name": "my car"}
    assert Address.of(str(address)) == address


def test_signs_of_an_option_survive_writing() -> None:
    address = Address("serial", "/dev/x", {"name": "a+b & c=d%20"})
    assert Address.of(str(address)) == address


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("udp:5555", ("127.0.0.1", 5555)),
        ("udp:0.0.0.0:1", ("0.0.0.0", 1)),
        ("udp:[::1]:65535", ("::1", 65535)),
    ],
)
def test_computer_and_port(text: str, place: tuple[str, int]) -> None:
    assert computer_and_port(Address.of(text), "127.0.0.1") == place


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "names no source"),
        ("COM3", "accepted are serial:PORT"),
        ("ftp:x", "names no source"),
        ("drive.inslab", "a recording is replay:drive.inslab; accepted are"),
        ("/dev/ttyUSB0", "a serial port is serial:/dev/ttyUSB0; accepted are"),
        ("COM3", "a serial port is serial:COM3; accepted are"),
        ("serial:", "names no serial source"),
        ("serial:a\nb", "names no serial source"),
        ("serial:/dev/x?baud=fast", "baud = 'fast'; accepted are 300 to 12000000"),
        ("serial:/dev/x?baud=nan", "accepted are"),
        ("serial:/dev/x?baud=115200.5", "whole numbers"),
        ("serial:/dev/x?speed=2", "'speed' is no option of a serial source; accepted are baud"),
        ("serial:/dev/x?" + "&".join(f"a{i}=1" for i in range(100)), "are no options"),
        ("serial:/dev/x?baud", "are no options"),
        ("tcp:5555", "names no port"),
        ("tcp:host:0", "names no port"),
        ("tcp:host:65536", "names no port"),
        ("udp:x", "names no port"),
        ("udp:" + "9" * 2000, "characters"),
        ("udp:5555?protocol=nmae", "'nmae' is no protocol; accepted are"),
        ("udp:5555?axes=x,y,-z", "mirror image"),
        ("udp:5555?rate=1e9", "accepted are 0.1 to 10000 Hz"),
        ("udp:5555?columns=time[parsec]", "is no unit of it"),
        ("udp:5555?columns=time[s]&protocol=nmea", "columns are of text lines"),
        ("replay:/nowhere.inslab", "cannot be read"),
        ("replay:/nowhere.inslab?speed=100", "speed = '100'; accepted are 0.1 to 10"),
        ("simulated:montreal?device=toaster", "is no device; accepted are vectornav"),
        ("simulated:montreal?over=udp:127.0.0.1:1", "accepted are pty and tcp:0"),
        ("simulated:pacific?rest=5", "begins at 83 m/s"),
        ("simulated:montreal?hz=0", "accepted are 1 to 2000 Hz"),
    ],
)
def test_what_names_no_source_is_refused_with_what_is_accepted(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words.replace("[", r"\[")):
        open_source(text)


@given(st.text(max_size=40), st.sampled_from(KINDS))
def test_any_text_is_an_address_or_refused(text: str, kind: str) -> None:
    for one in (text, f"{kind}:{text}"):
        try:
            address = Address.of(one)
        except TransportError:
            continue
        assert Address.of(str(address)).options == address.options


def test_a_simulated_source_without_the_room_that_simulates_is_refused_in_words() -> None:
    code = (
        "from lab.data.streams.source_opening import open_source\n"
        "try: open_source('simulated:montreal')\n"
        "except ValueError as error: print(error)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "lab.live.open" in ran.stdout
