"""Strict reader of a TOML table: every key is taken by name and checked; keys that remain are
errors.

Problems are collected instead of raised, so that one run reports them all. An invalid value is
replaced by a harmless default; this has no effect, because the document is refused in the end.
"""

from __future__ import annotations

import difflib
import math
from typing import Any, Callable, List, Optional, Sequence, Tuple

Vector = Tuple[float, ...]
REQUIRED: Any = object()


def nearest(name: str, known: Sequence[str]) -> str:
    """The hint for an unknown name: the nearest known one, and all of them."""
    close = difflib.get_close_matches(name, known, 1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"{hint}known: {', '.join(sorted(known)) or 'none'}"


def there_are(known: Sequence[str]) -> str:
    """The hint for a type of the model that has no twin."""
    return f"there are twins for {', '.join(sorted(known))}"


def is_number(value: Any) -> bool:
    """A finite TOML integer or float. (TOML booleans are Python ints; they do not count.)"""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


class Fields:
    """The keys of one table. `where` names the table in messages; `errors` collects them for the
    whole document.
    """

    def __init__(self, table: Any, where: str, errors: List[str]) -> None:
        self.where = where
        self.errors = errors
        self._seen: List[str] = []
        if not isinstance(table, dict):
            self.error(None, f"expected a table, found {table!r}")
            table = {}
        self._table = table

    def error(self, key: Optional[str], text: str) -> None:
        """Records a problem with `key` (or with the table as a whole)."""
        self.errors.append(f"{self.where}{'' if key is None else '.' + key}: {text}")

    def has(self, key: str) -> bool:
        """Whether the document gives this key."""
        return key in self._table

    def take(self, key: str, default: Any = None) -> Any:
        """The raw value, marked as read."""
        self._seen.append(key)
        if key in self._table:
            return self._table[key]
        if default is REQUIRED:
            self.error(key, "is required")
            return None
        return default

    def close(self) -> None:
        """Reports keys that were not taken."""
        for key in self._table:
            if key not in self._seen:
                self.error(key, f"unknown key; {nearest(key, self._seen)}")

    def kind(self) -> Optional[str]:
        """The plugin's `type`; None (and an error) if it is missing or not a string."""
        value = self.take("type", REQUIRED)
        if value is not None and not isinstance(value, str):
            self.error("type", f"expected a string, found {value!r}")
            return None
        return value

    def number(
        self, key: str, default: Any, accept: Callable[[float], bool] = lambda _: True, expected: str = "a number"
    ) -> float:
        """A finite number for which `accept` holds."""
        value = self.take(key, default)
        if value is None:
            return 1.0
        if not is_number(value) or not accept(float(value)):
            self.error(key, f"expected {expected}, found {value!r}")
            return 1.0
        return float(value)

    def flag(self, key: str, default: bool) -> bool:
        """true or false."""
        value = self.take(key, default)
        if not isinstance(value, bool):
            self.error(key, f"expected true or false, found {value!r}")
            return default
        return value

    def integer(self, key: str, default: Any, low: int, high: int) -> int:
        """An integer in [low, high]."""
        value = self.take(key, default)
        if value is None:
            return low
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            self.error(key, f"expected an integer from {low} to {high}, found {value!r}")
            return low
        return value

    def choice(self, key: str, default: Any, options: Sequence[str]) -> str:
        """One of the given words."""
        value = self.take(key, default)
        if value is None:
            return options[0]
        if value not in options:
            self.error(key, f"expected one of {', '.join(map(repr, options))}, found {value!r}")
            return options[0]
        return value

    def string(self, key: str, default: Any) -> str:
        """A non-empty string."""
        value = self.take(key, default)
        if value is None:
            return ""
        if not isinstance(value, str) or not value:
            self.error(key, f"expected a string, found {value!r}")
            return ""
        return value

    def vector(self, key: str, default: Any, size: int = 3) -> Vector:
        """An array of `size` finite numbers."""
        value = self.take(key, default)
        if value is None:
            return (1.0,) * size
        if not isinstance(value, (list, tuple)) or len(value) != size or not all(map(is_number, value)):
            self.error(key, f"expected an array of {size} finite numbers, found {value!r}")
            return (1.0,) * size
        return tuple(float(number) for number in value)

    def vectors(self, key: str, count: int, size: int, default: Any = None) -> Optional[List[Vector]]:
        """`count` arrays of `size` numbers, or None if the key is missing."""
        value = self.take(key, default)
        if value is None:
            return None
        good = isinstance(value, list) and len(value) == count
        good = good and all(isinstance(row, list) and len(row) == size and all(map(is_number, row)) for row in value)
        if not good:
            self.error(key, f"expected {count} arrays of {size} finite numbers each, found {value!r}")
            return None
        return [tuple(float(number) for number in row) for row in value]

    def color(self, key: str, default: Any, low: float = 0.0, high: float = math.inf) -> Vector:
        """A colour, grey or RGB, linear Rec. 709, each component in [low, high]."""
        value = self.take(key, default)
        if value is None:
            return (0.0, 0.0, 0.0)
        color = as_color(value)
        if color is None:
            self.error(key, f"expected a colour (a number or an array of three), found {value!r}")
            return (0.0, 0.0, 0.0)
        if not all(low <= component <= high for component in color):
            self.error(key, f"expected components {range_text(low, high)}, found {value!r}")
            return (0.0, 0.0, 0.0)
        return color


def as_color(value: Any) -> Optional[Vector]:
    """A number (grey) or three numbers as RGB; None for anything else."""
    if is_number(value):
        return (float(value),) * 3
    if isinstance(value, (list, tuple)) and len(value) == 3 and all(map(is_number, value)):
        return tuple(float(component) for component in value)
    return None


def range_text(low: float, high: float) -> str:
    """A range as text."""
    return f">= {low:g}" if math.isinf(high) else f"from {low:g} to {high:g}"
