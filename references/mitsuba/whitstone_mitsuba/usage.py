"""What the system says of this process's memory."""

from __future__ import annotations

from typing import Optional


class Memory:
    """How much the process grows from here on, at its highest."""

    def __init__(self) -> None:
        try:
            with open("/proc/self/clear_refs", "w", encoding="ascii") as file:
                file.write("5")  # the highest so far is forgotten
        except OSError:
            self._before: Optional[int] = None
        else:
            self._before = _status("VmRSS:")

    def grown(self) -> Optional[int]:
        """Bytes; None where the system does not tell."""
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
