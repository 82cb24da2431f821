"""The files that a document names, and whether they have changed since they were read."""

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
    """The folder that `file` paths are relative to; remembers which files were asked for and how
    they were then.
    """

    def __init__(self, base: str) -> None:
        self._base = base
        self._stamps: Dict[str, Optional[Tuple[int, int]]] = {}

    def path(self, name: str) -> str:
        """Where the file called `name` lies."""
        path = os.path.join(self._base, name)
        self._stamps[path] = _stamp(path)
        return path

    def unchanged(self) -> bool:
        """Whether every file asked for is as it was."""
        return all(_stamp(path) == stamp for path, stamp in self._stamps.items())
