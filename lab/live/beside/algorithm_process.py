"""Algorithm process: a live algorithm in a process of its own, so that nothing it does delays anybody.

A loop without an end, a call that keeps the lock of the interpreter, or memory without bounds cost the user's
own process, which is then ended. What comes back are bytes of numbers and of text, never objects.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Final

import numpy as np

from lab.base.arrays import FloatArray
from lab.live.beside.live_algorithm import (
    LiveAlgorithmError,
    Piece,
    load_live_algorithm,
    step_algorithm,
)
from lab.run.memory import limit_memory

START: Final = 60.0
"""Longest start of the process [s]: the algorithm's libraries may take 10 s on a busy computer."""
PATIENCE: Final = 10.0
"""Longest call of `step` [s]: a piece has half a second of samples, so this is twenty times too slow."""
MEMORY: Final = 4 * 10**9
"""Most memory beyond that of Python and its modules [bytes], as for a run with the settings of a student."""
_LOOK: Final = 0.05
"""Time between two looks whether the process shall end [s]."""
_NICENESS: Final = 10
"""By how much the process stands back when processors are few, as of nice(1)."""
_READY, _ATTITUDES, _FAILED = b"r", b"a", b"e"
"""First byte of what comes back."""


class AlgorithmProcess:
    """A live algorithm in a process of its own; used by one thread.

    Parameters
    ----------
    name
        What people call the algorithm.
    given
        Its place, as of `load_live_algorithm`, or an object with a method `made` that returns it, such as
        `lab.navigation.algorithm_source.AlgorithmSource`.
    goes_on
        Returns whether to wait on.
    """

    def __init__(self, name: str, given: object, goes_on: Callable[[], bool]) -> None:
        self._name, self._given, self._goes_on = name, given, goes_on
        self._process: BaseProcess | None = None
        self._line: Connection | None = None

    def start(self) -> None:
        """Start the process, and wait until the algorithm is loaded.

        Raises
        ------
        LiveAlgorithmError
            If it cannot be loaded.
        """
        # A fork would copy the locks that other threads hold at this moment, and never free them.
        context = get_context("spawn")
        self._line, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(far, self._name, self._given), daemon=True)
        self._process.start()
        # Only the process has this end now, so that its death shows at ours.
        far.close()
        self._answer(START, f"did not start within {START:g} s")

    def step(self, piece: Piece) -> FloatArray:
        """Return the attitudes (k, 4) of a piece, as of `lab.live.beside.live_algorithm.step_algorithm`.

        Raises
        ------
        LiveAlgorithmError
            If it fails, takes too long, or is to wait no longer.
        """
        assert self._line is not None
        try:
            self._line.send(piece)
        except OSError as error:
            raise LiveAlgorithmError(f"{self._name}: its process has ended") from error
        data = self._answer(PATIENCE, f"one step took more than {PATIENCE:g} s, and was stopped")
        return np.frombuffer(data, np.float64).reshape(-1, 4).copy()

    def end(self) -> None:
        """End the process; may be repeated."""
        if self._process is not None and self._process.pid is not None:
            # It may be in a computation that never returns to where it would hear a request.
            self._process.kill()
            self._process.join()
        if self._line is not None:
            self._line.close()
        self._process = self._line = None

    def _answer(self, longest: float, late: str) -> bytes:
        """Return what the process says."""
        assert self._line is not None
        until = time.monotonic() + longest
        try:
            while not self._line.poll(_LOOK):
                if not self._goes_on():
                    raise LiveAlgorithmError(f"{self._name}: was ended")
                if time.monotonic() > until:
                    raise LiveAlgorithmError(f"{self._name}: {late}")
            said = self._line.recv_bytes()
        except (EOFError, OSError) as error:
            raise LiveAlgorithmError(
                f"{self._name}: its process ended by itself; it may need more than {MEMORY / 1e9:g} GB"
            ) from error
        if said[:1] == _FAILED:
            raise LiveAlgorithmError(said[1:].decode("utf-8", "replace"))
        return said[1:]


def _serve(line: Connection, name: str, given: object) -> None:
    """Step an algorithm until the line is closed; in the process."""
    _prepare_process()
    try:
        algorithm = load_live_algorithm(given) if isinstance(given, str) else given.made()  # type: ignore[attr-defined]
        if not callable(getattr(algorithm, "step", None)):
            raise LiveAlgorithmError(f"{name}: has no method step(imu, fixes)")
        line.send_bytes(_READY)
        while True:
            line.send_bytes(_ATTITUDES + step_algorithm(algorithm, name, line.recv()).tobytes())
    except EOFError:
        return
    except ValueError as error:  # a place, a source or an attitude that is not accepted
        line.send_bytes(_FAILED + str(error).encode())


def _end_with(parent: BaseProcess) -> None:
    """End this process with the one that waits for it, which may have been killed."""
    parent.join()
    os._exit(1)


def _prepare_process() -> None:
    """End with the process that waits for this one, print beside its output, and take what others leave."""
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    os.dup2(2, 1)  # what the algorithm prints is not part of what a command prints
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    limit_memory(MEMORY)
