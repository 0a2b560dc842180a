"""The certificate of the phone server: for whom, for how long, and who may read it."""

from __future__ import annotations

import ipaddress
import socket
import ssl
import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from played_phone import Played, ask, batch

from lab.data.streams.transport import TransportError
from lab.live.phone import certificate as certificate_module
from lab.live.phone.certificate import certificate_file, read_certified_names
from lab.live.phone.hub import PhoneHub
from lab.live.phone.invitation import in_address, own_addresses
from lab.live.phone.server import PhoneServer

NAMES = ["192.168.0.20", "2001:db8::5", "localhost"]


def text_of(path: Path) -> str:
    """Return what OpenSSL reads in a certificate."""
    command = ["openssl", "x509", "-noout", "-text", "-in", str(path)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_a_browser_can_check_the_names(tmp_path):
    path = certificate_file(NAMES, tmp_path / "data" / "phone")
    text = text_of(path)
    assert "IP Address:192.168.0.20" in text
    assert "IP Address:2001:DB8:0:0:0:0:0:5" in text
    assert "DNS:localhost" in text
    assert "CA:FALSE" in text
    assert "TLS Web Server Authentication" in text


def test_a_client_that_trusts_it_connects_by_its_names_only(tmp_path):
    with PhoneServer(PhoneHub(), folder=tmp_path) as server:
        trusting = ssl.create_default_context(cafile=str(certificate_file([], tmp_path)))
        for name, fits in (("127.0.0.1", True), ("localhost", True), ("elsewhere.example", False)):
            with socket.create_connection((server.host, server.port), 10) as plain:
                if fits:
                    trusting.wrap_socket(plain, server_hostname=name).close()
                else:
                    with pytest.raises(ssl.SSLCertVerificationError, match="Hostname mismatch"):
                        trusting.wrap_socket(plain, server_hostname=name)


def test_only_the_user_can_read_it(tmp_path):
    path = certificate_file(NAMES, tmp_path / "phone")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert [one.name for one in path.parent.iterdir()] == [path.name]


def test_it_is_kept_while_it_fits(tmp_path):
    first = certificate_file(NAMES, tmp_path).read_bytes()
    assert certificate_file(NAMES[:1], tmp_path).read_bytes() == first
    other = certificate_file(["10.0.0.7"], tmp_path).read_bytes()
    assert other != first
    assert read_certified_names(tmp_path / "phone-server.pem") == {"10.0.0.7", *NAMES}
    assert certificate_file(NAMES, tmp_path).read_bytes() == other


def test_it_does_not_grow_for_ever(tmp_path):
    for number in range(50):
        path = certificate_file([f"10.0.0.{number}", "localhost"], tmp_path)
    names = read_certified_names(path)
    assert names is not None
    assert {"10.0.0.49", "localhost"} <= names
    assert len(names) == 32
    many = [f"10.0.{number}.1" for number in range(40)]
    assert read_certified_names(certificate_file(many, tmp_path)) == set(many)


@pytest.mark.parametrize(
    ("days", "renewed"), [(300, False), (365, False), (368, True), (500, True), (-3, True)]
)
def test_it_is_renewed_before_it_expires(tmp_path, monkeypatch, days, renewed):
    first = certificate_file(NAMES, tmp_path).read_bytes()

    class Later(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.now(tz) + timedelta(days=days)

    monkeypatch.setattr(certificate_module, "datetime", Later)
    path = certificate_file(NAMES, tmp_path)
    assert (path.read_bytes() != first) == renewed
    end = text_of(path).split("Not After : ")[1].split("\n")[0]
    left = datetime.strptime(end, "%b %d %H:%M:%S %Y GMT").replace(tzinfo=UTC) - Later.now(UTC)
    assert timedelta(days=29) < left < timedelta(days=398)


@pytest.mark.parametrize("damage", ["empty", "cut", "no key", "another key", "text"])
def test_a_damaged_file_is_made_anew(tmp_path, damage):
    path = certificate_file(NAMES, tmp_path)
    good = path.read_text()
    other = certificate_file(NAMES, tmp_path / "other").read_text()
    begin = good.index("-----BEGIN CERTIFICATE")
    damaged = {
        "empty": "",
        "cut": good[:-100],
        "no key": good[begin:],
        "another key": other[: other.index("-----BEGIN CERTIFICATE")] + good[begin:],
        "text": "not a certificate",
    }
    path.write_text(damaged[damage])
    assert read_certified_names(path) is None
    with PhoneServer(PhoneHub(), folder=tmp_path) as server:
        assert Played(server).post(batch(0)).status == 200
    assert path.read_text() != damaged[damage]


def test_a_folder_that_cannot_be_written_is_reported(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        certificate_file(NAMES, tmp_path / "file" / "phone")


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(TransportError, match=r"pip install 'ins-lab\[live\]'"):
        PhoneServer(PhoneHub(), folder=tmp_path).open()


def test_the_invitation_leads_to_the_page(tmp_path):
    with PhoneServer(PhoneHub(), folder=tmp_path, push_port=0) as server:
        ticket = server.hub.invite()
        invitation = server.invitation(ticket)
        assert ask(invitation.address).status == 200
        assert invitation.push_address == f"http://127.0.0.1:{server.push_port}/push/{ticket.token}"
        assert "this computer only" in invitation.problem
        assert 890 < invitation.left <= 900
        assert invitation.warning.count(". ") == 1  # two sentences
        rows = [list(row) for row in invitation.qr]
        assert len(rows) == len(rows[0])
        assert not any(any(row[:4] + row[-4:]) for row in rows)  # the quiet zone
        finder = ["1111111", "1000001", "1011101", "1011101", "1011101", "1000001", "1111111"]
        for down, right in ((4, 4), (4, -11), (-11, 4)):
            corner = [row[right : right + 7] for row in rows[down : down + 7 if down > 0 else -4]]
            assert ["".join("01"[one] for one in row) for row in corner] == finder


def test_addresses_of_this_computer():
    for one in own_addresses():
        address = ipaddress.ip_address(one)
        assert not address.is_loopback
        assert not address.is_unspecified
    assert in_address("2001:db8::1", 80) == "[2001:db8::1]:80"
    assert in_address("192.0.2.1", 80) == "192.0.2.1:80"


def test_all_networks(tmp_path, monkeypatch):
    monkeypatch.setattr("lab.live.phone.server.own_addresses", lambda: ["192.0.2.77"])
    with PhoneServer(PhoneHub(), "0.0.0.0", folder=tmp_path) as server:
        invitation = server.invitation(server.hub.invite())
        assert invitation.address.startswith(f"https://192.0.2.77:{server.port}/phone/")
        assert invitation.problem == ""
        assert read_certified_names(tmp_path / "phone-server.pem") == {"192.0.2.77", "127.0.0.1", "localhost"}
