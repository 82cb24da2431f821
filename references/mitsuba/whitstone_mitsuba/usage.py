"""Memory usage of this process, as the system reports it."""

from __future__ import annotations

from typing import Optional


class Memory:
    """Peak growth of the process from here on."""

    def __init__(self) -> None:
        try:
            with open("/proc/self/clear_refs", "w", encoding="ascii") as file:
                file.write("5")  # resets the recorded peak
        except OSError:
            self._before: Optional[int] = None
        else:
            self._before = _status("VmRSS:")

    def grown(self) -> Optional[int]:
        """Growth in bytes; None if the system does not report it."""
        highest = _status("VmHWM:")
        return None if self._before is None or highest is None else max(0, highest - self._before)


def _status(key: str) -> Optional[int]:
    try:
        with open("/proc/self/status", encoding="ascii", errors="replace") as file:
            for line in file:
                if line.startswith(key):
                    return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return None
