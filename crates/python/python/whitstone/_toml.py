"""Values as TOML, for changes of scenes and for scenes that are dictionaries."""

from __future__ import annotations

import json
import math
from typing import Any, Mapping


def value(item: Any) -> str:
    """A value in TOML.

    >>> value({"type": "sphere", "center": [0, 1.5, float("inf")]})
    '{"type" = "sphere", "center" = [0, 1.5, inf]}'
    >>> value(True)
    'true'
    """
    if hasattr(item, "tolist"):
        # An array or a number of NumPy.
        item = item.tolist()
    if isinstance(item, bool):
        return "true" if item else "false"
    if isinstance(item, int):
        return str(item)
    if isinstance(item, float):
        if math.isfinite(item):
            return repr(item)
        return "nan" if math.isnan(item) else ("inf" if item > 0 else "-inf")
    if isinstance(item, str):
        # JSON's escapes are TOML's, except for those of surrogates, which are not written.
        return json.dumps(item, ensure_ascii=False)
    if isinstance(item, Mapping):
        pairs = (f"{json.dumps(str(key), ensure_ascii=False)} = {value(inner)}" for key, inner in item.items())
        return "{" + ", ".join(pairs) + "}"
    if hasattr(item, "__fspath__"):
        return value(item.__fspath__())
    try:
        items = list(item)
    except TypeError:
        raise TypeError(f"{type(item).__name__} is no value of a scene") from None
    return "[" + ", ".join(map(value, items)) + "]"


def document(table: Mapping[str, Any]) -> str:
    """A TOML document of a dictionary.

    >>> document({"film": {"width": 8}})
    'film = {"width" = 8}'
    """
    return "\n".join(f"{key} = {value(item)}" for key, item in table.items())
