"""Clusters on this computer: a Dask scheduler and workers, each a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parent.parent
PATIENCE = 60.0
"""Longest wait for what a busy computer does within seconds [s]."""


@contextlib.contextmanager
def scheduler(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """Yield the process of a scheduler, and the file that it wrote."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    with _dask(
        folder, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", file
    ) as process:
        wait_for(lambda: file.is_file() and bool(_json(file)))
        yield process, file


@contextlib.contextmanager
def worker(
    folder: Path, file: Path, environment: Mapping[str, str] | None = None, threads: int = 1
) -> Iterator[subprocess.Popen[bytes]]:
    """Yield the process of a worker, which has no nanny that starts it again."""
    how = "--nthreads", str(threads), "--no-nanny", "--local-directory", folder
    with _dask(folder, "worker", "--scheduler-file", file, *how, environment=environment) as process:
        yield process


@contextlib.contextmanager
def _dask(
    folder: Path, what: str, *arguments: str | Path, environment: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    log = folder / f"{what}.log"
    paths = {"PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "tests")))}
    with log.open("ab") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", what, "--no-dashboard", *map(str, arguments)],
            stdout=output,
            stderr=output,
            env={**os.environ, **paths, **(environment or {})},
            cwd=folder,  # which Python searches for modules first
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def wait_for(condition: object) -> None:
    """Wait until a condition holds.

    Raises
    ------
    TimeoutError
        If it does not within `PATIENCE`.
    """
    until = time.monotonic() + PATIENCE
    while not condition():  # type: ignore[operator]
        if time.monotonic() > until:
            raise TimeoutError
        time.sleep(0.02)


def _json(file: Path) -> object:
    """Return what a file holds; nothing while it is being written."""
    try:
        return json.loads(file.read_text("utf-8"))
    except ValueError:
        return None
