"""Handover: what a server leaves for the one that is started after it on the same port.

These are the classes with what their teachers show, and the secrets by which browsers are known: that of the
visitors who have entered the password, and hashes of the links of teachers. They are in a file that only the
user can read, and are valid for some minutes.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import json
import os
import secrets
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.base.files.atomic_file import write_file

VALID = 900.0
"""Time for which a handover is taken [s]: a restart with an update of packages takes some minutes."""
OFTEN = 20_000
"""Time between two handovers of a server that may be killed without a warning [ms]."""
LARGEST = 2**20
"""Largest handover [bytes]: twenty classes with long settings take 200 kB."""
MOST_LINKS = 4
"""Most links of teachers that stay valid: those of the last four starts."""
_DIGEST = 64
"""Length of a hash, and of a secret, in hexadecimal digits."""


def folder() -> Path:
    """Return the folder of handovers, in the user's data folder of ``ins-lab``."""
    from platformdirs import user_data_path  # noqa: PLC0415 - takes a moment

    return user_data_path("ins-lab", appauthor=False) / "served"


@dataclass(frozen=True)
class Secrets:
    """By what the server knows browsers.

    Attributes
    ----------
    cookie : str
        Signs the cookies of visitors who have entered the password.
    teachers : tuple of str
        Hashes of the tokens in the links of teachers, in hexadecimal digits; the first is the newest.
    """

    cookie: str
    teachers: tuple[str, ...] = ()


class Handover:
    """The handover of the server on a port.

    Parameters
    ----------
    port
        The port.
    password
        Password of the server; None without one.
    """

    def __init__(self, port: int, password: str | None) -> None:
        self._path = folder() / f"{port}.json"
        self._password = (password or "").encode()
        self._before = _read(self._path)

    def secrets(self, token: str) -> Secrets:
        """Return the secrets of a server that starts, with a new token for teachers; empty without teachers.

        Those of the server before it stay, but no visitor who has entered another password.
        """
        cookie = _digits(self._before.get("cookie"))
        same = hmac.compare_digest(self._fingerprint(cookie), str(self._before.get("password")).encode())
        links = self._before.get("teachers")
        known = [link for link in links if _digits(link)] if isinstance(links, list) else []
        new = hashlib.sha256(token.encode()).hexdigest()
        return Secrets(
            cookie if cookie and same else secrets.token_hex(_DIGEST // 2),
            tuple([new, *known][:MOST_LINKS]) if token else (),
        )

    @property
    def classes(self) -> list[Any]:
        """The classes of the server before this one, as `dashboards.teaching.class_record` writes them."""
        found = self._before.get("classes")
        return found if isinstance(found, list) else []

    def leave(self, known: Secrets, classes: list[Any]) -> None:
        """Write the handover.

        Parameters
        ----------
        known
            The secrets of this server.
        classes
            Its classes, as plain data.
        """
        parts = {
            "written": time.time(),
            "cookie": known.cookie,
            "password": self._fingerprint(known.cookie).decode(),
            "teachers": known.teachers,
            "classes": classes,
        }
        with contextlib.suppress(OSError):  # a folder that cannot be written: the next server begins anew
            self._path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_file(self._path, json.dumps(parts), private=True)

    def _fingerprint(self, cookie: str) -> bytes:
        return hmac.new(cookie.encode(), self._password, "sha256").hexdigest().encode()


def _read(path: Path) -> dict[str, Any]:
    """Return a handover that is young enough and that only the user can have written; else an empty one."""
    try:
        with path.open("rb") as file:
            seen = os.fstat(file.fileno())
            is_own = not hasattr(os, "geteuid") or (seen.st_uid == os.geteuid() and not seen.st_mode & 0o077)
            found: Any = json.loads(file.read(LARGEST)) if is_own else None
        age = time.time() - found["written"]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return {}
    return dict(found) if 0 <= age <= VALID else {}


def _digits(value: object) -> str:
    """Return a hash or a secret in hexadecimal digits; empty if it is none."""
    is_one = isinstance(value, str) and len(value) == _DIGEST and set(value) <= set("0123456789abcdef")
    return str(value) if is_one else ""
