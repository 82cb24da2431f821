"""Reads the *setting* objects of PROTOCOL.md, which control the tracing."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any, Dict, List, Type, TypeVar

from .errors import DriverError

_S = TypeVar("_S", bound="SettingBase")


@dataclass(frozen=True)
class SettingBase:
    """The base of a driver's `Setting`, which adds the keys as fields, with their defaults."""

    @classmethod
    def read(cls: Type[_S], value: Any) -> _S:
        """Reads a setting from a request; missing keys take their defaults, unknown ones are
        refused.
        """
        if value is None:
            return cls()
        if not isinstance(value, dict):
            raise DriverError(f"setting: expected an object, found {value!r}")
        value = cls.without_ignored(value)
        known = [field.name for field in fields(cls)]
        unknown = sorted(set(value) - set(known))
        if unknown:
            raise DriverError(cls.describe_unknown(unknown, known))
        cls.check(value)
        return cls(**value)

    @classmethod
    def without_ignored(cls, value: Dict[str, Any]) -> Dict[str, Any]:
        """Removes keys whose values have no effect on this renderer."""
        return value

    @classmethod
    def describe_unknown(cls, unknown: List[str], known: List[str]) -> str:
        """The error for unknown keys."""
        return f"setting: unknown keys {', '.join(unknown)}; known: {', '.join(known)}"

    @classmethod
    def check(cls, value: Dict[str, Any]) -> None:
        """Raises `DriverError` if a value has the wrong type or is out of range."""

    def to_json(self) -> Dict[str, Any]:
        """All keys, with defaults filled in."""
        return asdict(self)
