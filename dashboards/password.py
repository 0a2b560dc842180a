"""Password: visitors must enter it once in each browser."""

from __future__ import annotations

import asyncio
import hmac
from collections.abc import Callable
from html import escape
from typing import Any
from urllib.parse import urlsplit

from bokeh.server.auth_provider import AuthProvider
from tornado.web import RequestHandler

from dashboards.forwarded import is_encrypted

COOKIE = "ins_lab_visitor"
"""Name of the cookie, before the port: browsers give the cookies of a host to all its ports."""
DAYS = 7
"""Time for which a browser stays logged in [days], at most until the server ends."""
PENALTY = 1.0
"""Delay of the answer to a wrong password [s]; it bounds the rate of guesses."""
TRIES = 8
"""Most wrong passwords that wait for their answer at once: eight guesses a second in all."""

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>INS Lab</title></head>
<body style="font-family: sans-serif; max-width: 22em; margin: 15vh auto; padding: 0 1em">
<h1>INS Lab</h1>
<form method="post">
<p><label>Password <input type="password" name="password" autocomplete="current-password" autofocus></label>
<button>Open</button></p>
<p role="alert">{problem}</p>
</form>
</body>
</html>
"""


class Password(AuthProvider):
    """Admits visitors who have entered the password.

    Parameters
    ----------
    password
        The password.
    port
        Port of the server.
    """

    def __init__(self, password: str, port: int) -> None:
        self._password = password.encode()
        self.cookie = f"{COOKIE}_{port}"
        self.waiting = 0
        super().__init__()

    def is_right(self, password: str) -> bool:
        """Return whether a password is right, in a time that does not depend on how similar it is."""
        return hmac.compare_digest(password.encode(errors="replace"), self._password)

    @property
    def get_user(self) -> Callable[[Any], Any]:
        """Function that returns the user of a request: a visitor who has entered the password, or None."""
        return self._visitor

    def _visitor(self, handler: Any) -> str | None:
        found = handler.get_signed_cookie(self.cookie, max_age_days=DAYS)
        return None if found is None else "visitor"

    @property
    def login_url(self) -> str:
        """Address of the login page."""
        return "/login"

    @property
    def login_handler(self) -> type[RequestHandler]:
        """Handler of the login page."""
        return PasswordHandler

    @property
    def get_user_async(self) -> None:
        """None: `get_user` returns at once."""

    @property
    def get_login_url(self) -> None:
        """None: the address of the login page is constant."""

    @property
    def logout_url(self) -> None:
        """None: there is no logout; a visitor can delete the cookie."""

    @property
    def logout_handler(self) -> None:
        """None, as `logout_url`."""


class PasswordHandler(RequestHandler):
    """Asks for the password, then redirects to the page."""

    def get(self) -> None:
        """Ask."""
        self._ask("")

    async def post(self) -> None:
        """Admit a visitor with the right password; the answer to a wrong one is delayed."""
        provider: Password = self.application.auth_provider  # type: ignore[attr-defined]  # of Bokeh's application
        if provider.waiting >= TRIES:
            self.set_status(429)
            self._ask("There were too many wrong passwords. Try again in a moment.")
            return
        if not provider.is_right(self.get_body_argument("password", "", strip=False)):
            provider.waiting += 1
            try:
                await asyncio.sleep(PENALTY)
            finally:
                provider.waiting -= 1
            self.set_status(403)
            self._ask("The password is wrong.")
            return
        secure = is_encrypted(self.request)
        self.set_signed_cookie(
            provider.cookie, "visitor", expires_days=DAYS, httponly=True, samesite="Lax", secure=secure
        )
        self.redirect(_own(self.get_query_argument("next", "/")))

    def _ask(self, problem: str) -> None:
        self.set_header("Cache-Control", "no-store")
        self.write(_PAGE.format(problem=escape(problem)))


def _own(address: str) -> str:
    """Return an address if it belongs to this server, otherwise that of the page."""
    try:
        parts = urlsplit(address)
    except ValueError:
        return "/"
    foreign = parts.scheme or parts.netloc or "\\" in address or not address.startswith("/")
    return "/" if foreign or address.startswith("//") or not address.isprintable() else address
