"""The *setting* objects of PROTOCOL.md, which control the tracing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Optional

from .errors import DriverError
from .fields import is_number


@dataclass(frozen=True)
class Setting:
    """See the table in PROTOCOL.md; `dx`, `dy` are in pixels, `k` and `ulps` in units of 2^-24."""

    k: float = 4.0
    robust: bool = True
    dx: float = 0.0
    dy: float = 0.0
    ulps: float = 0.0
    seed: int = 0
    vertices: bool = False
    largest: bool = False

    @property
    def vertex_seed(self) -> Optional[int]:
        """Seed of the stochastic rounding of vertices; None for rounding to the nearest."""
        return self.seed if self.vertices else None

    @staticmethod
    def read(value: Optional[Any]) -> "Setting":
        """Reads a setting from a request; missing keys take their defaults, unknown ones are
        refused.
        """
        if value is None:
            return Setting()
        if not isinstance(value, dict):
            raise DriverError(f"setting: expected an object, found {value!r}")
        unknown = sorted(set(value) - set(asdict(Setting())))
        if unknown:
            raise DriverError(f"setting: unknown keys {', '.join(unknown)}; known: {', '.join(asdict(Setting()))}")
        for key, number in value.items():
            good = isinstance(number, bool) if key in ("robust", "vertices", "largest") else is_number(number)
            good = good and (key != "seed" or (isinstance(number, int) and 0 <= number < 2**32))
            good = good and (key not in ("k", "ulps") or number >= 0)
            if not good:
                raise DriverError(f"setting.{key}: {number!r} has the wrong type or is out of range")
        return Setting(**value)

    def to_json(self) -> dict:
        """All keys, with defaults filled in."""
        return asdict(self)
