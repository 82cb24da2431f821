"""The files that a document refers to, and whether they changed after they were read."""

from __future__ import annotations

import os
from typing import Dict, Optional, Tuple


def _stamp(path: str) -> Optional[Tuple[int, int]]:
    try:
        status = os.stat(path)
    except OSError:
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
        self._stamps[path] = _stamp(path)
        return path

    def unchanged(self) -> bool:
        """Whether every requested file is unchanged."""
        return all(_stamp(path) == stamp for path, stamp in self._stamps.items())
