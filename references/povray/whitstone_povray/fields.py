"""Strict reader of a table of the document: a key that is not taken is an error, since its effect
would be missing from the twin.
"""

from __future__ import annotations

import difflib
import math
import os
from dataclasses import dataclass, field
from typing import Any, Callable, List, Optional, Sequence, Tuple

from .settings import Setting

Vector = Tuple[float, ...]
REQUIRED: Any = object()


@dataclass
class Context:
    """State shared by all readers of a document."""

    base: str
    setting: Setting
    # The only colour channel to render (red, green or blue); None for all at once.
    channel: Optional[int] = None
    errors: List[str] = field(default_factory=list)
    # Each preceded by the position in the document, as `shape[3]: ...`.
    unsupported: List[str] = field(default_factory=list)


def nearest(name: str, known: Sequence[str]) -> str:
    """The hint for an unknown name."""
    close = difflib.get_close_matches(name, known, 1)
    return (f"did you mean {close[0]!r}? " if close else "") + f"known: {', '.join(sorted(known))}"


def is_number(value: Any) -> bool:
    """A finite number; TOML's booleans do not count."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


class Fields:
    """The keys of one table; `where` is its position in the document."""

    def __init__(self, table: Any, where: str, context: Context) -> None:
        self.where = where
        self.context = context
        self._taken: List[str] = []
        if not isinstance(table, dict):
            context.errors.append(f"{where}: expected a table, found {table!r}")
            table = {}
        self._table = table

    def error(self, key: str, text: str) -> None:
        """Records that the document is invalid."""
        self.context.errors.append(f"{self.where}.{key}: {text}" if key else f"{self.where}: {text}")

    def unsupported(self, text: str, key: str = "") -> None:
        """Records that something in the document has no twin."""
        self.context.unsupported.append(f"{self.where}.{key}: {text}" if key else f"{self.where}: {text}")

    def has(self, key: str) -> bool:
        """Whether the document contains the key."""
        return key in self._table

    def take(self, key: str, default: Any = None) -> Any:
        """The raw value, marked as read."""
        self._taken.append(key)
        if key in self._table:
            return self._table[key]
        if default is REQUIRED:
            self.error(key, "is required")
            return None
        return default

    def close(self) -> None:
        """Reports keys that were not taken."""
        for key in self._table:
            if key not in self._taken:
                self.error(key, f"unknown key; {nearest(key, self._taken)}")

    def _checked(self, key: str, default: Any, good: Callable[[Any], bool], expected: str, stand_in: Any) -> Any:
        """A valid value, or a harmless default until the document is refused."""
        value = self.take(key, default)
        if value is None and (default is None or default is REQUIRED):
            return stand_in
        if not good(value):
            self.error(key, f"expected {expected}, found {value!r}")
            return stand_in
        return value

    def number(self, key: str, default: Any, good: Callable[[float], bool] = lambda _: True, expected: str = "a number") -> float:
        """A finite number for which `good` holds."""
        return float(self._checked(key, default, lambda value: is_number(value) and good(value), expected, 1.0))

    def integer(self, key: str, default: Any, low: int, high: int) -> int:
        """An integer from `low` to `high`."""
        def good(value: Any) -> bool:
            return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high

        return self._checked(key, default, good, f"an integer from {low} to {high}", low)

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        return self._checked(key, default, lambda value: isinstance(value, bool), "true or false", default)

    def choice(self, key: str, default: str, words: Sequence[str]) -> str:
        """One of the given words."""
        return self._checked(key, default, lambda value: value in words, f"one of {', '.join(words)}", words[0])

    def text(self, key: str, default: Any = None) -> str:
        """A string; empty if it is missing."""
        return self._checked(key, default, lambda value: isinstance(value, str) and value != "", "a text", "")

    def vector(self, key: str, default: Any, size: int = 3) -> Vector:
        """An array of `size` finite numbers."""
        def good(value: Any) -> bool:
            return isinstance(value, (list, tuple)) and len(value) == size and all(map(is_number, value))

        return tuple(float(number) for number in self._checked(key, default, good, f"{size} finite numbers", (1.0,) * size))

    def vectors(self, key: str, count: int, size: int) -> Optional[List[Vector]]:
        """`count` vectors, or None if the key is missing."""
        def good(value: Any) -> bool:
            rows = isinstance(value, list) and len(value) == count
            return rows and all(isinstance(row, list) and len(row) == size and all(map(is_number, row)) for row in value)

        rows = self._checked(key, None, good, f"{count} arrays of {size} finite numbers", None)
        return None if rows is None else [tuple(float(number) for number in row) for row in rows]

    def color(self, key: str, default: Any, high: float = math.inf) -> Vector:
        """A colour in [0, `high`]: all channels, or the channel that is rendered, repeated three
        times.
        """
        found = self._checked(key, default, lambda value: as_color(value) is not None, "a number or three", 0.0)
        color = as_color(found) or (0.0, 0.0, 0.0)
        if not all(0 <= component <= high for component in color):
            self.error(key, f"expected components from 0 to {high:g}, found {found!r}")
        return self.seen(color)

    def seen(self, color: Vector) -> Vector:
        """A colour as this rendering uses it."""
        channel = self.context.channel
        return color if channel is None else (color[channel],) * 3

    def path(self, key: str) -> str:
        """The path of a file."""
        return os.path.join(self.context.base, self.text(key, REQUIRED))


def as_color(value: Any) -> Optional[Vector]:
    """A number (grey) or three; None for anything else."""
    if is_number(value):
        return (float(value),) * 3
    if isinstance(value, (list, tuple)) and len(value) == 3 and all(map(is_number, value)):
        return tuple(float(component) for component in value)
    return None
