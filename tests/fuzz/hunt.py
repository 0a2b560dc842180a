"""Hunt: attack all readers, decoders and pushes of phones, then a served laboratory; ``make fuzz`` runs it.

``make fuzz SECONDS=30 NAME=GPX`` runs a part. Each reader has a process of its own, half of the time with
mutations of whole files, half of it led by the branches it takes (atheris, where it is installed). What
breaks one is kept in ``fuzz-findings``. Each attack prints its seed, and ``--seed`` repeats it.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import faulthandler
import importlib.util
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path

ROOT = Path(__file__).parents[2]
FINDINGS = ROOT / "fuzz-findings"
MEMORY = 4 * 2**30
"""Most address space beyond which an attack counts as lost [bytes]."""
HANG = 60
"""Processor time after which a single attack is given up [s]; a busy machine is no hang."""
LABORATORY = "served laboratory"


def main() -> int:
    """Attack one after the other; return 1 if one is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--name", default="")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--engine", choices=list(ENGINES), default="")
    chosen = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    if chosen.engine:
        print(f"{chosen.name}, {chosen.engine}: seed {chosen.seed}", flush=True)
        return ENGINES[chosen.engine](chosen.name, chosen.seconds, chosen.seed)
    from attack import BY_NAME
    from pushes import PHONE_SERVER, PUSHES
    from streams import DECODER_NAMES

    others = dict.fromkeys(DECODER_NAMES, "bytes") | dict.fromkeys(PUSHES, "pushes")
    others |= {PHONE_SERVER: "phones", LABORATORY: "doors"}
    of_readers = ["mutations", "atheris"] if importlib.util.find_spec("atheris") else ["mutations"]
    if len(of_readers) == 1:
        print("atheris is not installed here (Linux and macOS, Python 3.11 to 3.13): mutations only")
    broken = []
    for name in (*BY_NAME, *others):
        if chosen.name.lower() not in name.lower():
            continue
        engines = [others[name]] if name in others else of_readers
        for engine in engines:
            command = [sys.executable, __file__, "--engine", engine, "--name", name]
            command += ["--seconds", str(chosen.seconds / len(engines)), "--seed", str(chosen.seed)]
            begun = time.monotonic()
            code = subprocess.run(command, check=False, cwd=ROOT).returncode
            print(
                f"{name}, {engine}: {'well' if not code else 'BROKEN'} ({time.monotonic() - begun:.0f} s)",
                flush=True,
            )
            broken += [f"{name} ({engine})"] if code else []
    print("all hold" if not broken else f"broken: {', '.join(broken)}; see {FINDINGS}")
    return 1 if broken else 0


def limit_memory() -> None:
    """Turn memory without bound into an exception."""
    if importlib.util.find_spec("resource"):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def watch(seconds: float) -> None:
    """End the process with its traceback after more processor time than this; never with zero."""
    if hasattr(signal, "setitimer"):
        faulthandler.register(signal.SIGPROF, chain=True)
        signal.setitimer(signal.ITIMER_PROF, seconds)
    elif seconds:
        faulthandler.dump_traceback_later(seconds, exit=True)
    else:
        faulthandler.cancel_dump_traceback_later()


def keep(name: str, folder: Path, error: BaseException) -> None:
    """Keep the files of an attack, and what went wrong."""
    kept = FINDINGS / re.sub(r"\W+", "_", name) / str(time.time_ns())
    shutil.copytree(folder, kept)
    (kept / "traceback.txt").write_text("".join(traceback.format_exception(error)))
    print(f"{name}: {type(error).__name__}: {str(error)[:300]}; kept in {kept}", flush=True)


def keep_bytes(name: str, data: bytes, error: BaseException) -> None:
    """Keep the bytes of an attack, and what went wrong."""
    with tempfile.TemporaryDirectory() as temporary:
        (Path(temporary) / "stream.bin").write_bytes(data)
        keep(name, Path(temporary), error)


def repeat(name: str, seconds: float, attack: Callable[[int], int], save: Callable[[Exception], None]) -> int:
    """Attack for a time, or until five attacks have broken something; tell how many there were.

    Parameters
    ----------
    name
        What is attacked.
    seconds
        For how long [s].
    attack
        Called with the number of the attack; returns how much of the data was still taken.
    save
        Called with what an attack raised.
    """
    limit_memory()
    count = taken = broken = 0
    end = time.monotonic() + seconds
    while time.monotonic() < end and broken < 5:
        watch(HANG)
        try:
            taken += attack(count)
        except Exception as error:
            broken += 1
            save(error)
        count += 1
    watch(0)
    print(f"{name}: {count} attacks; flights, samples, fixes and requests that were taken: {taken}")
    return 1 if broken else 0


def by_mutations(name: str, seconds: float, seed: int) -> int:
    """Attack a reader with mutations of its seeds."""
    import numpy as np
    from attack import attack, rebuild, seeds
    from mutations import mutated

    files, rng = seeds(name), np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)

        def once(count: int) -> int:
            hostile = {file: mutated(one, rng) for file, one in files.items()}
            flight = attack(name, folder, hostile, weigh=count % 20 == 0)
            if flight is not None and count % 10 == 0:
                rebuild([folder / file for file in hostile])
            return flight is not None

        return repeat(name, seconds, once, lambda error: keep(name, folder, error))


def by_atheris(name: str, seconds: float, seed: int) -> int:
    """Attack a reader with inputs led by the branches it takes; does not return."""
    import atheris

    with atheris.instrument_imports(include=["lab.data"]):
        from attack import attack, seeds

    files = seeds(name, 2.5)
    folder, corpus = Path(tempfile.mkdtemp()), Path(tempfile.mkdtemp())
    first, *others = files
    (corpus / "seed").write_bytes(files[first])

    def once(data: bytes) -> None:
        try:
            attack(name, folder, {first: data} | {file: files[file] for file in others})
        except Exception as error:
            keep(name, folder, error)
            raise

    most = max(4096, 2 * len(files[first]))
    options = [
        f"-max_total_time={seconds:.0f}",
        f"-seed={seed}",
        f"-timeout={HANG}",
        f"-rss_limit_mb={MEMORY // 2**20}",
    ]
    options += [f"-max_len={most}", f"-artifact_prefix={folder}/", "-verbosity=0", "-print_final_stats=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], once)
    atheris.Fuzz()
    return 0


def by_bytes(name: str, seconds: float, seed: int) -> int:
    """Attack a decoder with mutations of a stream, in pieces of any size; half of them pass every check."""
    import numpy as np
    from mutations import mutated
    from streams import DECODER_NAMES, attack_decoder, same, seeds, unchecked

    protocol, rng = DECODER_NAMES[name], np.random.default_rng(seed)
    streams, hostile = seeds(protocol), b""

    def once(count: int) -> int:
        nonlocal hostile
        hostile = mutated(streams[count % len(streams)], rng)
        with unchecked() if count % 2 else contextlib.nullcontext():
            found = attack_decoder(protocol, hostile, int(rng.integers(1, 1000)))
            assert same(found, attack_decoder(protocol, hostile, max(len(hostile), 1)))
        return len(found.imu) + len(found.fix)

    return repeat(name, seconds, once, lambda error: keep_bytes(name, hostile, error))


def by_pushes(name: str, seconds: float, seed: int) -> int:
    """Attack what reads the requests of phones."""
    import numpy as np
    from pushes import PUSHES, changed

    (make, attack), rng = PUSHES[name], np.random.default_rng(seed)
    good, hostile = make(), b""

    def once(_count: int) -> int:
        nonlocal hostile
        hostile = changed(good, rng)
        return attack(hostile)

    return repeat(name, seconds, once, lambda error: keep_bytes(name, hostile, error))


def by_phones(name: str, seconds: float, seed: int) -> int:
    """Attack a server for phones."""
    import numpy as np
    from pushes import besiege_phones

    broken: list[str] = []

    def keep_request(what: str, sent: bytes) -> None:
        broken.append(what)
        keep_bytes(name, sent, AssertionError(what))

    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as temporary:
        rng = np.random.default_rng(seed)
        answers = besiege_phones(Path(temporary), rng, lambda _count: time.monotonic() > end, keep_request)
    print(f"{name}: answers {dict(answers)}")
    return 1 if broken else 0


def by_doors(name: str, seconds: float, seed: int) -> int:
    """Attack a laboratory that is served, by requests, messages, settings files and handshakes."""
    import numpy as np
    from doors import besiege

    from tests.security.conftest import serving

    broken: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)

        def keep_attacks(what: str, sent: Iterable[tuple[str, bytes]]) -> None:
            broken.append(what)
            for number, (door, data) in enumerate(sent):
                (folder / f"{number:02}_{door.replace(' ', '_')}").write_bytes(data)
            keep(name, folder, AssertionError(what))

        with serving(folder, "--visitors", "run") as served:
            end = time.monotonic() + seconds
            rng = np.random.default_rng(seed)
            work = besiege(served, rng, lambda _count: time.monotonic() > end, keep_attacks)
            asyncio.run(work)
    return 1 if broken else 0


ENGINES: dict[str, Callable[[str, float, int], int]] = {
    "mutations": by_mutations,
    "atheris": by_atheris,
    "bytes": by_bytes,
    "pushes": by_pushes,
    "phones": by_phones,
    "doors": by_doors,
}

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    sys.exit(main())
