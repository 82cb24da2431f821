"""How to trace: the *setting* objects of PROTOCOL.md, as far as POV-Ray can vary."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from .errors import DriverError

# POV-Ray's guards against self-intersection are lengths (1e-3 for shadows), not relative. The scene
# is made larger, so that they are small beside it; by a power of two, which leaves the numbers of
# meshes, in single precision, as they are.
_SCALE_TIMES_K = 4096.0


@dataclass(frozen=True)
class Setting:
    """See README.md; `dx`, `dy` are in pixels."""

    # POV-Ray's guards, in units of 1e-3/4096 m; the default is 1e-6 m.
    k: float = 4.0
    dx: float = 0.0
    dy: float = 0.0
    # Of the rounding of vertices.
    seed: int = 0
    # Whether the vertices of meshes are rounded to single precision at random, not to the nearest.
    vertices: bool = False
    # All light is made so many times brighter and the image darker again: other roundings to half
    # precision.
    exposure: float = 1.0

    @property
    def scale(self) -> float:
        """POV-Ray's units in a metre."""
        return _SCALE_TIMES_K / self.k

    @staticmethod
    def read(value: Any) -> "Setting":
        """From a request; absent keys take their defaults, unknown ones are refused."""
        if value is None:
            return Setting()
        if not isinstance(value, dict):
            raise DriverError(f"setting: expected an object, found {value!r}")
        # POV-Ray computes in double precision: it has no traversal and no roundings to vary.
        value = {key: entry for key, entry in value.items() if (key, entry) not in (("robust", True), ("ulps", 0))}
        unknown = sorted(set(value) - set(asdict(Setting())))
        if unknown:
            raise DriverError(f"setting: POV-Ray cannot vary {', '.join(unknown)}; it can {', '.join(asdict(Setting()))}")
        setting = Setting(**value)
        if not (setting.k > 0 and setting.exposure > 0):
            raise DriverError(f"setting: {value!r} is not possible")
        return setting

    def to_json(self) -> dict:
        """All keys, defaults filled in."""
        return asdict(self)
