"""Numbers in the syntax of POV-Ray's scene language."""

from __future__ import annotations

from typing import Iterable


def number(value: float) -> str:
    """A decimal number that reads back as exactly this double."""
    return repr(float(value) + 0.0)


def vector(values: Iterable[float]) -> str:
    """`<x, y, z>`."""
    return "<" + ",".join(number(value) for value in values) + ">"


def rgb(color: Iterable[float]) -> str:
    """An opaque colour."""
    return "rgb " + vector(color)


def vector_of_integers(values: Iterable[int]) -> str:
    """`<1,2,3>`."""
    return "<" + ",".join(str(value) for value in values) + ">"
