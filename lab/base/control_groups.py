"""Control groups: where Linux says how much of the computer a container, or a service, may use."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

ROOT = Path("/sys/fs/cgroup")


def folders(controller: str) -> Iterator[tuple[Path, int]]:
    """Iterate over the folders of this process's control groups and of their parents.

    Parameters
    ----------
    controller
        What is controlled, such as ``"memory"``.

    Yields
    ------
    tuple
        The folder, and the version of its files.
    """
    for line in text(Path("/proc/self/cgroup")).splitlines():
        _, kinds, path = [*line.split(":", 2), "", ""][:3]
        if kinds and controller not in kinds.split(","):
            continue
        root, version = (ROOT / controller, 1) if kinds else (ROOT, 2)
        group = root / path.lstrip("/")
        # In a container, the path may be that of the host, and only the root is visible.
        for folder in (group, *group.parents):
            yield folder, version
            if folder == root:
                break


def text(path: Path) -> str:
    """Return the content of a file of the system; empty if there is none."""
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
