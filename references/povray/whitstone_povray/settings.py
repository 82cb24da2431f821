"""The *setting* objects of PROTOCOL.md, as far as POV-Ray supports them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from .errors import DriverError

# POV-Ray's self-intersection thresholds are absolute lengths (1e-3 for shadows). The scene is
# scaled up, so that they are relatively small. The factor is a power of two, so that the
# single-precision mesh data does not change.
_SCALE_TIMES_K = 4096.0


@dataclass(frozen=True)
class Setting:
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

    @staticmethod
    def read(value: Any) -> "Setting":
        """Reads a setting from a request; missing keys take their defaults, unknown ones are
        refused.
        """
        if value is None:
            return Setting()
        if not isinstance(value, dict):
            raise DriverError(f"setting: expected an object, found {value!r}")
        # POV-Ray computes in double precision and has no robust traversal, so these settings are
        # ignored if they have their default values.
        value = {key: entry for key, entry in value.items() if (key, entry) not in (("robust", True), ("ulps", 0))}
        unknown = sorted(set(value) - set(asdict(Setting())))
        if unknown:
            raise DriverError(f"setting: POV-Ray does not support {', '.join(unknown)}; supported: {', '.join(asdict(Setting()))}")
        setting = Setting(**value)
        if not (setting.k > 0 and setting.exposure > 0):
            raise DriverError(f"setting: `k` and `exposure` must be > 0, found {value!r}")
        return setting

    def to_json(self) -> dict:
        """All keys, with defaults filled in."""
        return asdict(self)
