"""Finds twins by name: the twin of the shape `sphere` is the function `twin` of `shapes/sphere.py`,
and so on for all families.
"""

from __future__ import annotations

import importlib
import os
from typing import Any, Callable, List, Optional

from .fields import Fields, nearest


def names(family: str) -> List[str]:
    """The types that have a twin."""
    folder = os.path.join(os.path.dirname(os.path.abspath(__file__)), family)
    files = (entry for entry in os.listdir(folder) if entry.endswith(".py") and not entry.startswith("_"))
    return sorted(entry[: -len(".py")] for entry in files)


def find(family: str, fields: Fields) -> Optional[Callable[..., Any]]:
    """The twin of the table's `type`; None, with a reason in the context, if there is none."""
    kind = fields.take("type")
    known = names(family)
    if not isinstance(kind, str):
        fields.error("type", "is required and must be a string")
        return None
    if kind not in known:
        fields.unsupported(f"POV-Ray has no twin of the {family[:-1]} type {kind!r}; {nearest(kind, known)}")
        return None
    return importlib.import_module(f"{__package__}.{family}.{kind}").twin
