"""Teacher: who may open and lead classes: whoever has opened the link that `ins-lab serve --teacher` prints.

The link holds a random token. It is exchanged for a cookie at once, because the address bar of a teacher is
projected. The right is that of a teacher and nothing else: a password is still asked for, and missions may be
changed only if `--visitors edit` says so. The token is valid until the server ends, and on the server that is
started in its place within some minutes (`dashboards.handover`).
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Mapping, Sequence

from tornado.web import RequestHandler

from dashboards.forwarded import is_encrypted

COOKIE = "ins_lab_teacher"
"""Name of the cookie, before the port: browsers give the cookies of a host to all its ports."""
PATH = "teach"
"""Path of the link, after that of the page."""
NOT_VALID = (
    "This is not a valid link for a teacher. The command “ins-lab serve --teacher” prints one each time the "
    "server starts; a link from long before is not valid any more."
)
_LONGEST = 200
"""Longest text that is compared with the token [characters]; a token has 43."""

_PAGE = f"""<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>INS Lab</title></head>
<body style="font-family: sans-serif; max-width: 30em; margin: 15vh auto; padding: 0 1em">
<h1>INS Lab</h1>
<p role="alert">{NOT_VALID}</p>
</body>
</html>
"""

_digest: list[bytes] = []
"""Hashes of the tokens of this server, the newest first; empty where nobody teaches."""
_port: list[int] = []
"""Port of the server of this process; empty where nobody teaches."""


def new_token() -> str:
    """Return a random token."""
    return secrets.token_urlsafe(32)


def admit_holders(port: int, digests: Sequence[bytes]) -> None:
    """Let those teach who hold a token with one of some hashes, on the server of a port."""
    _digest[:], _port[:] = digests, [port]


def is_token(text: str) -> bool:
    """Return whether a text is the token, in a time that does not depend on how similar it is."""
    given = _hash(text[:_LONGEST])
    return any(hmac.compare_digest(given, one) for one in _digest)


def is_teacher(cookies: Mapping[str, str]) -> bool:
    """Return whether a browser with these cookies has opened the link for teachers."""
    return is_token(cookies.get(cookie_name(), ""))


def cookie_name() -> str:
    """Return the name of the cookie of teachers of this server."""
    return "_".join((COOKIE, *map(str, _port)))


class TeachHandler(RequestHandler):
    """Answers the link for teachers: sets the cookie, and goes on to the page without the token."""

    def get(self) -> None:
        """Exchange the token for a cookie."""
        self.set_header("Cache-Control", "no-store")
        token = self.get_query_argument("key", "")
        if not is_token(token):
            self.set_status(403)
            self.write(_PAGE)
            return
        secure = is_encrypted(self.request)
        self.set_cookie(cookie_name(), token, httponly=True, samesite="Lax", secure=secure)
        self.redirect("./")


def _hash(text: str) -> bytes:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest()
