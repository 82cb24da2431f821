"""The files that a document refers to, and whether they changed after they were read."""

from __future__ import annotations

import os
from typing import Dict, Optional, Tuple


def stamp(path: str) -> Optional[Tuple[int, int]]:
    """The state of a file; None if it cannot be read."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size


class Folder:
    """The folder that `file` paths are relative to. It records the requested files and their state
    at that time.
    """

    def __init__(self, base: str) -> None:
        self._base = base
        self._stamps: Dict[str, Optional[Tuple[int, int]]] = {}

    def path(self, name: str) -> str:
        """The path of the file `name`."""
        path = os.path.join(self._base, name)
        self._stamps[path] = stamp(path)
        return path

    def note(self, stamps: Dict[str, Optional[Tuple[int, int]]]) -> None:
        """Records files that a requested file refers to, with their state when they were read."""
        self._stamps.update(stamps)

    def unchanged(self) -> bool:
        """Whether every requested file is unchanged."""
        return all(stamp(path) == state for path, state in self._stamps.items())
