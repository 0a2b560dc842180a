"""Cluster: pieces of work on the workers of a Dask cluster, whose results are the same whoever computes them.

Everything that the pieces need travels as one `Parcel`, to each worker once. A worker that is killed costs
the piece it worked on, which another one does again. If the scheduler is lost, what is done is kept.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
import os
import socket
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import numba
from distributed import Client, Future, KilledWorker, Security, Worker, WorkerPlugin, as_completed, get_worker
from distributed.comm.addressing import get_address_host_port
from distributed.comm.core import CommClosedError

from lab.base.blas_threads import OneBlasThread
from lab.experiment.ensembles.parcel import (
    Parcel,
    Unpacked,
    VersionError,
    check_versions,
    describe_differences,
)
from lab.experiment.experiment import Experiment

__all__ = ["Parcel", "check_client", "connected", "run_pieces"]

Piece = Callable[..., Any]

PATIENCE = 10.0
"""Longest wait for a scheduler [s]: one that runs answers within milliseconds."""
LONGEST_FILE = 2**20
"""Largest part of a scheduler's file that is read [bytes]: it holds a line for each worker."""
AHEAD = 16
"""Smallest number of pieces that are begun, or done, while an earlier one is not."""
AHEAD_OF_EACH = 3
"""The same for each thread of the cluster: a worker finds its next piece without asking."""
ASKED_EVERY = 0.05
"""Time between two looks for results, and questions whether the work is cancelled [s]."""
WARM_RATE = 50.0
"""Rate of the IMU in the run that compiles the kernels of a worker [Hz]: the code is that of any rate."""
_PACKAGES = {"lab": "ins-lab", "numba": "numba", "numpy": "numpy"}
"""How packages are called where they are installed."""
_SAME = "accepted are a scheduler and workers with the lab, numba and numpy of this computer"
LOST = "The connection to the cluster was lost: the runs that were not done are missing."
"""What ended the work when the scheduler, or the way to it, did."""


@contextlib.contextmanager
def connected(place: str) -> Iterator[Client]:
    """Yield a client of a scheduler.

    Parameters
    ----------
    place
        Its address, such as ``tcp://192.168.1.5:8786``, or ``tls://`` with the certificates that Dask's own
        configuration names; or the file that it wrote (``dask scheduler --scheduler-file FILE``).

    Raises
    ------
    ValueError
        If no scheduler answers there, or there is no such file.
    """
    try:
        client = _client(place if "://" in place else _address_in(Path(place)))
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{place}: {error}; accepted is an address such as tcp://192.168.1.5:8786, or the file that a "
            "scheduler wrote"
        ) from error
    with client:
        yield client


def _client(address: str) -> Client:
    """Return a client of the scheduler at an address.

    What is wrong with the address is found before: a client that cannot begin takes long to give up.
    """
    get_address_host_port(address, strict=True)
    if address.startswith("tls:") and Security().get_connection_args("client")["ssl_context"] is None:
        raise ValueError("tls:// needs certificates; Dask's configuration names them (distributed.comm.tls)")
    # Not the default of the process: only who names a scheduler uses it.
    return Client(address, timeout=PATIENCE, set_as_default=False)


def _address_in(path: Path) -> str:
    """Return the address in the file that a scheduler wrote.

    Raises
    ------
    ValueError
        If there is none.
    """
    if not path.is_file():
        raise ValueError("there is no such file")
    with path.open("rb") as file, contextlib.suppress(ValueError):
        values = json.loads(file.read(LONGEST_FILE))
        if isinstance(values, dict) and isinstance(values.get("address"), str):
            return str(values["address"])
    raise ValueError("the file holds no address of a scheduler")


def run_pieces(
    client: Client,
    parcel: Parcel,
    piece: Piece,
    arguments: Sequence[tuple[Any, ...]],
    done: Callable[[int, Any], None],
    *,
    tell: Callable[[str], None] = lambda _step: None,
    warming: tuple[Any, ...] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> str:
    """Compute pieces of work on the workers of a cluster.

    Parameters
    ----------
    client
        The client of the cluster; see `check_client`.
    parcel
        What all pieces need.
    piece
        A function of the lab, called with the unpacked parcel and the arguments of a piece.
    arguments
        The arguments of each piece.
    done
        Called with the number of a piece and its result, in any order. An exception that it raises, and
        Ctrl-C, end the work: the pieces that are left are cancelled.
    tell
        Called with a sentence before the work starts.
    warming
        Arguments of a first short piece that compiles what the others need; None without one.
    cancelled
        Asked again and again; once it says so, the pieces that are left are cancelled.

    Returns
    -------
    str
        A sentence about what ended the work before all was done; empty if nothing did.

    Raises
    ------
    ValueError
        If the workers have other versions; and what a piece raises.
    """
    name = f"ins-lab-{uuid.uuid4().hex}"
    sent: list[Future[Any]] = []
    running: dict[Future[Any], int] = {}
    try:
        _check_versions(client, parcel.versions)
        workers: dict[str, int] = client.nthreads()
    except OSError:
        return LOST
    tell(f"Preparing {len(workers)} workers" if workers else "Waiting for the first worker of the cluster")
    try:
        client.register_plugin(Preparation(parcel, piece, warming), name=name)
        sent.append(client.submit(_itself, parcel, key=f"ins-lab-parcel-{parcel.digest}", pure=False))
        most, left = max(AHEAD, AHEAD_OF_EACH * sum(workers.values())), deque(enumerate(arguments))
        results = as_completed(loop=client.loop, with_results=True, raise_errors=False)
        while (left or running) and client.status == "running":
            while left and left[0][0] < min(running.values(), default=left[0][0]) + most:
                index, one = left.popleft()
                future = client.submit(_computed, sent[0], piece, one, key=f"{name}-{index}", pure=False)
                running[future] = index
                results.add(future)
            while not results.has_ready():
                if cancelled is not None and cancelled():
                    return ""
                time.sleep(ASKED_EVERY)
            future, result = next(results)
            index = running.pop(future)
            if isinstance(result, CancelledError):
                return LOST
            if future.status == "error":
                return _failed(result[1])
            future.release()
            done(index, result)
    except CommClosedError:
        return LOST
    else:
        return LOST if left or running else ""
    finally:
        if client.status == "running":  # a scheduler that is lost forgets everything by itself
            client.cancel(list(running))
            for future in sent:
                future.release()  # a traceback would hold it
            with contextlib.suppress(OSError):
                client.unregister_worker_plugin(name)


class Preparation(WorkerPlugin):
    """What a worker does before the first piece of some work: it compares versions, and compiles.

    Parameters
    ----------
    parcel
        What the pieces need.
    piece, warming
        As of `run_pieces`.
    """

    def __init__(self, parcel: Parcel, piece: Piece, warming: tuple[Any, ...] | None) -> None:
        self.host = socket.gethostname()
        self.versions = parcel.versions
        self._settings = {name: parcel.settings[0][name] for name in ("sensors", "navigator")}
        self._piece, self._warming = piece, warming

    async def setup(self, worker: Worker) -> None:
        """Prepare a worker, which goes on talking to its scheduler meanwhile."""
        try:
            await asyncio.to_thread(self.prepare)
        except VersionError as error:
            raise VersionError(f"client: the worker {worker.address} has {error}; {_SAME}") from None

    def prepare(self) -> None:
        """Prepare this process.

        Raises
        ------
        VersionError
            If its versions are others.
        """
        check_versions(self.versions)
        if socket.gethostname() != self.host:
            keep_compiled_code_for_this_host()
        if self._warming is not None:
            _warm(json.dumps(self._settings), self._piece, self._warming)


def keep_compiled_code_for_this_host() -> None:
    """Keep compiled code in a folder of this host, unless ``NUMBA_CACHE_DIR`` names one.

    Several hosts may share the user's home, and Numba's files are not made for this: hosts would overwrite
    each other's index.
    """
    if vars(numba.config)["CACHE_DIR"]:
        return
    from platformdirs import user_cache_path  # noqa: PLC0415 - only needed here

    folder = user_cache_path("ins-lab") / f"compiled_{socket.gethostname()}"
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    vars(numba.config)["CACHE_DIR"] = str(folder)


@functools.cache
def _warm(settings: str, piece: Piece, arguments: tuple[Any, ...]) -> None:
    """Compile what pieces of work need, or load it; of the processes of a host, one compiles a kernel."""
    experiment = Experiment()
    # What is refused here is refused in the work itself, which says so.
    with contextlib.suppress(ValueError, OSError), OneBlasThread():
        experiment.update({"trajectory.imu_rate": WARM_RATE, **json.loads(settings)})
        piece(Unpacked([experiment]), *arguments)


def _itself(parcel: Parcel) -> Parcel:
    """Return a parcel: as a task, it is sent again if the worker that has it is killed."""
    return parcel


@OneBlasThread()
def _computed(parcel: Parcel, piece: Piece, arguments: tuple[Any, ...]) -> Any:
    """Return the result of a piece of work, on a worker."""
    return piece(parcel.unpack(Path(get_worker().local_directory) / "ins-lab"), *arguments)


def check_client(client: Client, workers: int | None = None) -> None:
    """Raise `ValueError` if a client cannot be used, or a number of threads is given beside it."""
    if workers is not None:
        raise ValueError(
            f"workers: {workers!r} is for threads of this computer; accepted is None beside a client"
        )
    accepted = "accepted is a client of a Dask cluster, such as dask.distributed.Client()"
    if not isinstance(client, Client):
        raise ValueError(f"client: {client!r:.60} is of type {type(client).__name__}; {accepted}")  # noqa: TRY004
    if client.asynchronous:
        raise ValueError(f"client: is asynchronous; {accepted}, without asynchronous=True")
    if client.status != "running":
        raise ValueError(f"client: is {client.status}, and not connected to a scheduler; {accepted}")


def _check_versions(client: Client, wanted: dict[str, str]) -> None:
    """Raise `VersionError` if the scheduler or a worker lacks what is needed, before work is sent there."""
    found: Any = client.get_versions(packages=list(_PACKAGES.values()))
    here = found["client"]["packages"]
    others = {f"worker {address}": worker for address, worker in found["workers"].items()}
    for other, answer in {"scheduler": found["scheduler"], **others}.items():
        there = answer["packages"]
        wrong = describe_differences(
            *({name: one.get(package) for name, package in _PACKAGES.items()} for one in (here, there))
        )
        if wrong:
            raise VersionError(f"client: the {other} has {wrong}; {_SAME}")
    try:  # Dask unpacks all work on the scheduler, too
        client.run_on_scheduler(check_versions, wanted)
    except VersionError as error:
        raise VersionError(f"client: the scheduler has {error}; {_SAME}") from None
    except (ImportError, AttributeError) as error:
        raise VersionError(f"client: the scheduler has another lab ({error}); {_SAME}") from None


def _failed(error: BaseException) -> str:
    """Return a sentence about a piece that nobody can compute; raise what the piece itself raised."""
    if isinstance(error, KilledWorker):
        return (
            f"{error.allowed_failures + 1} workers of the cluster ended in the middle of the same runs, the "
            f"last at {error.last_worker.address}: perhaps these need more memory."
        )
    if isinstance(error, VersionError | ImportError):
        return f"A worker joined the cluster that cannot do this work: {error}."
    raise error
