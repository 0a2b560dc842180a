"""Mutants: how many one-line faults, put into `lab` at random, the tests of `make test` find.

``python -m tests.benchmarks.mutants [COUNT] [--seed SEED] [--seconds SECONDS] [--only NUMBER...]`` draws
COUNT (40) code lines of `lab`, all with the same chance, and makes one fault in each: a sign, a comparison, a
number by a percent or by one, a `not` left out, two arguments exchanged. Each fault stands alone in a copy of
the tree. There, the tests without the marks `proof`, `benchmark` and `browser` run until the first one fails:
first the files that import the module, then those whose name holds its name, then those of its folder and
its room, the shorter first, until the process used SECONDS (60) of processor. A failure counts if the same
test passes without the fault.
What survives so few tests may be found by all of them, and may be no fault at all: read it.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
MARKS = "not proof and not benchmark and not browser"
PATIENCE = 8
"""Longest time of a run, in the processor time that it may take: other programs may hold the processor."""
SWAPPED: dict[type[ast.AST], tuple[str, ...]] = {
    ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"), ast.Add: ("+", "-"), ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.And: ("and", "or"), ast.Or: ("or", "and"),
}  # fmt: skip
"""What stands for an operator, and what the fault writes instead."""


@dataclass(frozen=True)
class Mutant:
    """One fault: in `file`, the bytes from `start` to `stop` become `text`."""

    file: Path
    line: int
    start: int
    stop: int
    text: str

    def applied(self, source: bytes) -> bytes:
        """Return the text of the file with the fault."""
        return source[: self.start] + self.text.encode() + source[self.stop :]


def mutants(file: Path, source: bytes) -> Iterator[Mutant]:
    """Yield each fault that can be put into a file of Python."""
    starts = [0]
    for row in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(row))

    def begin(node: ast.expr) -> int:
        return starts[node.lineno - 1] + node.col_offset

    def end(node: ast.expr) -> int:
        return starts[(node.end_lineno or 1) - 1] + (node.end_col_offset or 0)

    def between(left: ast.expr, right: ast.expr, sign: ast.AST) -> Iterator[Mutant]:
        old, new = SWAPPED.get(type(sign), ("", ""))
        pattern = rb"\s+".join(re.escape(word.encode()) for word in old.split())
        found = re.search(pattern, source[end(left) : begin(right)]) if old else None
        if found:
            at = end(left) + found.start()
            line = source.count(b"\n", 0, at) + 1
            yield Mutant(file, line, at, end(left) + found.end(), new)

    for node in _computed(ast.parse(source)):
        if isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
            for left, sign, right in zip(operands, node.ops, operands[1:], strict=False):
                yield from between(left, right, sign)
        elif isinstance(node, ast.BinOp):
            yield from between(node.left, node.right, node.op)
        elif isinstance(node, ast.BoolOp):
            yield from between(node.values[0], node.values[1], node.op)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            # Only the sign or the word: a parenthesis after it closes behind the operand.
            sign = len("not") if isinstance(node.op, ast.Not) else len("-")
            yield Mutant(file, node.lineno, begin(node), begin(node) + sign, "")
        elif isinstance(node, ast.Constant) and type(node.value) in {int, float, bool}:
            yield Mutant(file, node.lineno, begin(node), end(node), repr(_other(node.value)))
        elif isinstance(node, ast.Call) and len(node.args) > 1:
            one, two = node.args[:2]
            if not any(isinstance(arg, ast.Starred) for arg in (one, two)):
                first, second = source[begin(one) : end(one)], source[begin(two) : end(two)]
                text = (second + source[end(one) : begin(two)] + first).decode()
                yield Mutant(file, one.lineno, begin(one), end(two), text)


def _computed(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that run: no type hints, and nothing between the parts of a text."""
    for name, value in ast.iter_fields(tree):
        if name in {"annotation", "returns", "type_params"} or isinstance(tree, ast.JoinedStr):
            continue
        for node in value if isinstance(value, list) else [value]:
            if isinstance(node, ast.AST):
                yield node
                yield from _computed(node)


def _other(value: float) -> float | bool:
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) else value * 1.01 or 0.01


def drawn(root: Path, count: int, seed: int) -> list[Mutant]:
    """Return a fault in each of `count` lines of `lab`; all in which one can be made have the same chance."""
    lines: dict[tuple[Path, int], list[Mutant]] = {}
    for path in sorted((root / "lab").rglob("*.py")):
        for mutant in mutants(path.relative_to(root), path.read_bytes()):
            lines.setdefault((mutant.file, mutant.line), []).append(mutant)
    chance = random.Random(seed)
    return [chance.choice(lines[line]) for line in chance.sample(sorted(lines), count)]


def nearest_tests(root: Path, file: Path) -> list[str]:
    """Return the files of tests that are near a file of `lab`, the nearest and shortest first."""
    name = ".".join(file.with_suffix("").parts).removesuffix(".__init__")
    stem, folder = name.split(".")[-1], Path("tests", *file.parts[1:-1])
    imports = re.compile(
        rf"\b{re.escape(name)}\b|from {re.escape(name.rpartition('.')[0])} import [^\n]*\b{stem}\b"
    )
    while not (root / folder).is_dir():
        folder = folder.parent
    room = Path("tests", file.parts[1]) if len(file.parts) > 2 else Path("tests")
    ranked = {}
    for path in sorted((root / "tests").rglob("test_*.py")):
        here, text = path.relative_to(root), path.read_text("utf-8")
        imported, named = bool(imports.search(text)), stem in path.stem
        ranks = [imported and named, imported, named, here.is_relative_to(folder), True]
        if here.is_relative_to(room) or imported or named:
            ranked[here.as_posix()] = ranks.index(True), len(text)
    return sorted(ranked, key=ranked.__getitem__)


def tried(root: Path, tests: list[str], seconds: int) -> tuple[str, str]:
    """Return how a run of tests ends, passed, failed or cut, and the first test that failed."""
    options = ["-q", "-x", "-m", MARKS, "-n", "0", "-p", "no:cacheprovider", "--no-header", "-rfE"]

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))

    try:
        ended = subprocess.run(
            [sys.executable, "-m", "pytest", *options, *tests],
            cwd=root,
            env=os.environ | {"PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(root.with_name("compiled"))},
            preexec_fn=limit,
            capture_output=True,
            text=True,
            timeout=PATIENCE * seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "cut", ""
    if ended.returncode < 0:
        return "cut", ""
    failed = re.search(r"^(?:FAILED|ERROR) (\S.*?)(?: - |$)", ended.stdout, re.M)
    # 5: no test was chosen.
    return ("passed" if ended.returncode in {0, 5} else "failed"), failed.group(1) if failed else ""


def main() -> None:
    """Put in the faults, and print which of them the tests found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=40)
    parser.add_argument("--seed", type=int, default=38)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of the faults to try again")
    options = parser.parse_args()
    found = drawn(ROOT, options.count, options.seed)
    killed = tried_count = 0
    print(f"{options.count} faults, seed {options.seed}, {options.seconds} s of processor each", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "tree"
        unwanted = shutil.ignore_patterns(".git", ".venv", "__pycache__", "build")
        shutil.copytree(ROOT, copy, ignore=unwanted)
        for number, mutant in enumerate(found):
            if options.only and number not in options.only:
                continue
            source = (copy / mutant.file).read_bytes()
            tests = nearest_tests(copy, mutant.file)
            end, test = "", ""
            while tests and end in {"", "failed"}:
                (copy / mutant.file).write_bytes(mutant.applied(source))
                end, test = tried(copy, tests, options.seconds)
                (copy / mutant.file).write_bytes(source)
                if not test or tried(copy, [test], options.seconds)[0] != "failed":
                    break
                tests.remove(test.split("::")[0])  # it fails without the fault, too
                end = ""
            tried_count += 1
            killed += end == "failed"
            before = source[mutant.start : mutant.stop].decode()
            print(f"{number:3} {'killed' if end == 'failed' else 'SURVIVED':8} {mutant.file}:{mutant.line}")
            print(f"    {' '.join(before.split())}  ->  {' '.join(mutant.text.split()) or '(nothing)'}")
            print(f"    {test or f'{len(tests)} files of tests: {end}'}", flush=True)
    print(f"{killed} of {tried_count} faults are found: {killed / max(tried_count, 1):.0%}")


if __name__ == "__main__":
    main()
