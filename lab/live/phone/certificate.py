"""Certificate: what the phone server shows to browsers, made by itself and kept in the user's data folder."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from lab.base.files.atomic_file import write_file

if TYPE_CHECKING:
    from cryptography.x509 import GeneralName

VALID: Final = timedelta(days=397)
"""Apple's systems accept certificates of at most 398 days."""
EARLY: Final = timedelta(days=30)
"""Time before it expires at which it is renewed: a session never ends in the middle."""
_SKEW: Final = timedelta(days=1)
"""Time by which the clock of a phone may be late."""
_FILE: Final = "phone-server.pem"
_MOST_NAMES: Final = 32
"""Most names of a certificate: without a bound, that of a laptop that travels would grow for ever."""


def data_folder() -> Path:
    """Return the folder of the certificate in the user's data folder of ``ins-lab``."""
    from platformdirs import user_data_path  # noqa: PLC0415 - tests name another folder

    return user_data_path("ins-lab", appauthor=False) / "phone"


def certificate_file(names: Iterable[str], folder: Path | None = None) -> Path:
    """Return a file with a private key and a certificate, made anew if there is none that fits.

    A certificate fits if it is for all the names and valid for a month to come. The names of an old one are
    kept, so that a computer that changes between networks keeps one certificate, and a phone warns once.
    Only the user can read the file.

    Parameters
    ----------
    names
        Addresses and host names by which phones reach the server.
    folder
        Where it is kept; by default `data_folder`.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    folder = data_folder() if folder is None else folder
    path = folder / _FILE
    wanted = set(names)
    known = read_certified_names(path)
    if known is not None and wanted <= known:
        return path
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    old = sorted((known or set()) - wanted)[: max(_MOST_NAMES - len(wanted), 0)]
    content = _make_certificate(sorted(wanted) + old)
    write_file(path, content, private=True)
    return path


def read_certified_names(path: Path) -> set[str] | None:
    """Return the names that the certificate of a file is for; None if it does not exist or expires soon."""
    from cryptography import x509  # noqa: PLC0415 - slow, and needed with phones only
    from cryptography.hazmat.primitives.serialization import load_pem_private_key  # noqa: PLC0415

    try:
        content = path.read_bytes()
        found = x509.load_pem_x509_certificate(content)
        key = load_pem_private_key(content, None)
        named = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, TypeError, x509.ExtensionNotFound):
        return None
    if key.public_key() != found.public_key():
        return None
    now = datetime.now(UTC)
    if not found.not_valid_before_utc <= now <= found.not_valid_after_utc - EARLY:
        return None
    return {
        *named.get_values_for_type(x509.DNSName),
        *map(str, named.get_values_for_type(x509.IPAddress)),
    }


def _make_certificate(names: list[str]) -> bytes:
    """Return a new key and a certificate that it signs itself, as PEM."""
    from cryptography import x509  # noqa: PLC0415
    from cryptography.hazmat.primitives import hashes, serialization  # noqa: PLC0415
    from cryptography.hazmat.primitives.asymmetric import ec  # noqa: PLC0415
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID  # noqa: PLC0415

    key = ec.generate_private_key(ec.SECP256R1())
    title = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "INS Lab on this computer")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(title)
        .issuer_name(title)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _SKEW)
        .not_valid_after(now - _SKEW + VALID)
        .add_extension(x509.SubjectAlternativeName([_name(one) for one in names]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(key, hashes.SHA256())
    )
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return private + made.public_bytes(serialization.Encoding.PEM)


def _name(one: str) -> GeneralName:
    from cryptography import x509  # noqa: PLC0415

    try:
        return x509.IPAddress(ipaddress.ip_address(one))
    except ValueError:
        return x509.DNSName(one)
