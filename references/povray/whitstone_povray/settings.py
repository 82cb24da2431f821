"""The *setting* objects of PROTOCOL.md, as far as POV-Ray supports them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, List

from whitstone_protocol.errors import DriverError
from whitstone_protocol.settings import SettingBase

# POV-Ray's self-intersection thresholds are absolute lengths (1e-3 for shadows). The scene is
# scaled up, so that they are relatively small. The factor is a power of two, so that the
# single-precision mesh data does not change.
_SCALE_TIMES_K = 4096.0


@dataclass(frozen=True)
class Setting(SettingBase):
    """See README.md; `dx`, `dy` are in pixels."""

    # POV-Ray's self-intersection threshold, in units of 1e-3/4096 m; the default is 1e-6 m.
    k: float = 4.0
    dx: float = 0.0
    dy: float = 0.0
    # Seed of the rounding of vertices.
    seed: int = 0
    # Whether mesh vertices are rounded stochastically to single precision, instead of to the
    # nearest.
    vertices: bool = False
    # A factor on all light, divided out of the image again: it changes the rounding to half
    # precision.
    exposure: float = 1.0

    @property
    def scale(self) -> float:
        """POV-Ray units per metre."""
        return _SCALE_TIMES_K / self.k

    @classmethod
    def without_ignored(cls, value: Dict[str, Any]) -> Dict[str, Any]:
        """POV-Ray computes in double precision and has no robust traversal, so these settings are
        ignored if they have their default values.
        """
        return {key: entry for key, entry in value.items() if (key, entry) not in (("robust", True), ("ulps", 0))}

    @classmethod
    def describe_unknown(cls, unknown: List[str], known: List[str]) -> str:
        """See `SettingBase`."""
        return f"setting: POV-Ray does not support {', '.join(unknown)}; supported: {', '.join(known)}"

    @classmethod
    def check(cls, value: Dict[str, Any]) -> None:
        """See `SettingBase`."""
        if not (value.get("k", cls.k) > 0 and value.get("exposure", cls.exposure) > 0):
            raise DriverError(f"setting: `k` and `exposure` must be > 0, found {value!r}")
