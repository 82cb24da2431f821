"""The *setting* objects of PROTOCOL.md, which control the tracing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, Optional

from whitstone_protocol.errors import DriverError
from whitstone_protocol.settings import SettingBase

from .fields import is_number


@dataclass(frozen=True)
class Setting(SettingBase):
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

    @classmethod
    def check(cls, value: Dict[str, Any]) -> None:
        """See `SettingBase`."""
        for key, number in value.items():
            good = isinstance(number, bool) if key in ("robust", "vertices", "largest") else is_number(number)
            good = good and (key != "seed" or (isinstance(number, int) and 0 <= number < 2**32))
            good = good and (key not in ("k", "ulps") or number >= 0)
            if not good:
                raise DriverError(f"setting.{key}: {number!r} has the wrong type or is out of range")
