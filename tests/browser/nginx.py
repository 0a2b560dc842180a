"""nginx, with the text of `docs/serving.md`: a proxy with TLS before a laboratory on this computer."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lab.live.phone.certificate import certificate_file
from tests.browser.conftest import ROOT, free_port

PROGRAM = os.environ.get("INS_LAB_NGINX") or shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
"""nginx; on Debian, ``apt-get install nginx-light``, or another one named in ``INS_LAB_NGINX``."""

_AROUND = """
daemon off;
worker_processes 1;
error_log stderr;
pid {folder}/nginx.pid;
events {{ worker_connections 512; }}
http {{
    access_log {folder}/access.log;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
{recipe}
}}
"""


def recipe() -> str:
    """Return what the documentation tells to write into the configuration of nginx."""
    found = re.search(r"```nginx\n(.*?)```", (ROOT / "docs" / "serving.md").read_text("utf-8"), re.DOTALL)
    assert found is not None
    return found[1]


@contextmanager
def nginx_before(port: int, folder: Path) -> Iterator[int]:
    """Run nginx before the laboratory on a port, until the end of the context; give its port.

    Only ports, names and files of the text in the documentation are replaced.
    """
    if PROGRAM is None:
        pytest.skip("nginx is not installed: apt-get install nginx-light")
    listens = free_port()
    pem = certificate_file(["localhost", "127.0.0.1"], folder)
    text = recipe()
    for old, new in (
        ("listen 443 ssl;", f"listen 127.0.0.1:{listens} ssl;"),
        ("server_name lab.example.org;", "server_name localhost;"),
        ("/etc/ssl/lab.example.org.pem", str(pem)),
        ("/etc/ssl/lab.example.org.key", str(pem)),
        ("http://127.0.0.1:5006", f"http://127.0.0.1:{port}"),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    settings = folder / "nginx.conf"
    settings.write_text(_AROUND.format(folder=folder, recipe=text), "utf-8")
    command = [PROGRAM, "-p", str(folder), "-c", str(settings)]
    subprocess.run([*command, "-t"], check=True, capture_output=True)
    log = folder / "nginx.log"
    with log.open("wb") as sink, subprocess.Popen(command, stdout=sink, stderr=sink) as process:
        try:
            yield listens
        finally:
            process.terminate()
            process.wait(30)
