"""Sealing: what of a homework can be signed and sealed, with the package cryptography.

A `TeacherKey` signs the homework (Ed25519) and opens what is handed in: the lab of the student seals each
hand-in for the teacher's public key (X25519, ChaCha20-Poly1305), so that no other student can read or change
it. The name of a homework is a digest of both public keys; another key therefore makes another homework.

The hidden settings of a homework file must be opened by the lab of the student to simulate them. Their key
comes from the file itself: they cannot be read by eye or with a text editor, but this program can open them,
and so can a person who calls its functions.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey

MISSING = "homework needs cryptography, which is not installed: pip install 'ins-lab[homework]'"
SECRET = 32
"""Length of the secret of a teacher's key [bytes]: 256 bits."""
PUBLIC = 64
"""Length of both public keys together [bytes]."""
NAME = 16
"""Length of the name of a homework [hexadecimal digits]: 64 bits."""
_NONCE = 12
"""Length of a nonce of ChaCha20-Poly1305 [bytes] (RFC 8439)."""
_POINT = 32
"""Length of a public key on Curve25519 [bytes] (RFC 7748, RFC 8032)."""


class SealError(ValueError):
    """Something that the key does not open, or whose signature is wrong; or cryptography is missing."""


def check_installed() -> None:
    """Raise `SealError` if the package cryptography is not installed."""
    try:
        import cryptography  # noqa: F401, PLC0415 - an optional dependency
    except ImportError as error:
        raise SealError(MISSING) from error


@dataclass(frozen=True, repr=False)
class TeacherKey:
    """The secret of one homework.

    Attributes
    ----------
    secret : bytes
        The secret, of `SECRET` bytes; all keys come from it.
    """

    secret: bytes

    @classmethod
    def new(cls) -> TeacherKey:
        """Return a random key."""
        return cls(secrets.token_bytes(SECRET))

    @cached_property
    def public(self) -> bytes:
        """The public keys: that of signatures, and that for which hand-ins are sealed."""
        return self._signing.public_key().public_bytes_raw() + self._opening.public_key().public_bytes_raw()

    @property
    def name(self) -> str:
        """The name of the homework."""
        return name_of_keys(self.public)

    def sign(self, content: bytes) -> bytes:
        """Return the signature of a content."""
        return self._signing.sign(content)

    def open(self, sealed: bytes, context: str) -> bytes:
        """Return what was sealed for this key by `seal_for_teacher`.

        Raises
        ------
        SealError
            If it was sealed for another key or in another context, or has been changed.
        """
        from cryptography.exceptions import InvalidTag  # noqa: PLC0415 - optional
        from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PublicKey  # noqa: PLC0415
        from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305  # noqa: PLC0415

        sender, nonce = sealed[:_POINT], sealed[_POINT : _POINT + _NONCE]
        try:
            shared = self._opening.exchange(X25519PublicKey.from_public_bytes(sender))
            key = _derive_key(shared, sender + self.public, context)
            return ChaCha20Poly1305(key).decrypt(nonce, sealed[_POINT + _NONCE :], context.encode())
        except (InvalidTag, ValueError) as error:
            raise SealError("is sealed for another key, or has been changed since") from error

    def digest_of(self, what: str, name: str) -> bytes:
        """Return 32 bytes that follow from a student's name, and that only this secret gives (HMAC-SHA256).

        Parameters
        ----------
        what
            What the bytes are for: two purposes give unlike bytes.
        name
            The name.
        """
        return hmac.digest(self._varying, f"{what}\0{name}".encode(), "sha256")

    @cached_property
    def _varying(self) -> bytes:
        return _derive_key(self.secret, b"", "variants of a homework")

    @cached_property
    def _signing(self) -> Ed25519PrivateKey:
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey  # noqa: PLC0415

        return Ed25519PrivateKey.from_private_bytes(_derive_key(self.secret, b"", "signature of a homework"))

    @cached_property
    def _opening(self) -> X25519PrivateKey:
        from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey  # noqa: PLC0415

        return X25519PrivateKey.from_private_bytes(_derive_key(self.secret, b"", "hand-ins of a homework"))


def name_of_keys(public: bytes) -> str:
    """Return the name of the homework with these public keys: `NAME` hexadecimal digits."""
    return hashlib.sha256(public).hexdigest()[:NAME]


def check_signature(public: bytes, signature: bytes, content: bytes) -> None:
    """Raise `SealError` if a signature is not that of a content by the owner of the public keys."""
    from cryptography.exceptions import InvalidSignature  # noqa: PLC0415 - optional
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey  # noqa: PLC0415

    try:
        Ed25519PublicKey.from_public_bytes(public[:_POINT]).verify(signature, content)
    except (InvalidSignature, ValueError) as error:
        raise SealError("has been changed since the teacher signed it; accepted is the original") from error


def seal_for_teacher(public: bytes, content: bytes, context: str) -> bytes:
    """Return a content that only the owner of the public keys can open; each time it looks different."""
    from cryptography.hazmat.primitives.asymmetric.x25519 import (  # noqa: PLC0415 - optional
        X25519PrivateKey,
        X25519PublicKey,
    )
    from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305  # noqa: PLC0415

    own = X25519PrivateKey.generate()
    receiver: X25519PublicKey = X25519PublicKey.from_public_bytes(public[_POINT:])
    sender, nonce = own.public_key().public_bytes_raw(), secrets.token_bytes(_NONCE)
    key = _derive_key(own.exchange(receiver), sender + public, context)
    return sender + nonce + ChaCha20Poly1305(key).encrypt(nonce, content, context.encode())


def cover(public: bytes, content: bytes) -> bytes:
    """Return hidden settings as bytes that cannot be read by eye; this program opens them with `uncover`."""
    from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305  # noqa: PLC0415 - optional

    nonce = secrets.token_bytes(_NONCE)
    key = _derive_key(public, nonce, "hidden settings of a homework")
    return nonce + ChaCha20Poly1305(key).encrypt(nonce, content, public)


def uncover(public: bytes, covered: bytes) -> bytes:
    """Return what `cover` has covered.

    Raises
    ------
    SealError
        If it has been changed.
    """
    from cryptography.exceptions import InvalidTag  # noqa: PLC0415 - optional
    from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305  # noqa: PLC0415

    nonce = covered[:_NONCE]
    try:
        key = _derive_key(public, nonce, "hidden settings of a homework")
        return ChaCha20Poly1305(key).decrypt(nonce, covered[_NONCE:], public)
    except (InvalidTag, ValueError) as error:
        raise SealError("has hidden settings that cannot be opened; accepted is the original") from error


def _derive_key(secret: bytes, salt: bytes, purpose: str) -> bytes:
    """Return a key of 32 bytes for one purpose (HKDF, RFC 5869)."""
    from cryptography.hazmat.primitives.hashes import SHA256  # noqa: PLC0415 - optional
    from cryptography.hazmat.primitives.kdf.hkdf import HKDF  # noqa: PLC0415

    return HKDF(SHA256(), 32, salt, f"ins-lab: {purpose}".encode()).derive(secret)
