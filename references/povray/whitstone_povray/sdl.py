"""Numbers as POV-Ray's scene language writes them."""

from __future__ import annotations

from typing import Iterable


def number(value: float) -> str:
    """Digits from which a double is read back exactly."""
    return repr(float(value) + 0.0)


def vector(values: Iterable[float]) -> str:
    """`<x, y, z>`."""
    return "<" + ",".join(number(value) for value in values) + ">"


def rgb(color: Iterable[float]) -> str:
    """A colour that nothing passes through."""
    return "rgb " + vector(color)


def vector_of_integers(values: Iterable[int]) -> str:
    """`<1,2,3>`."""
    return "<" + ",".join(str(value) for value in values) + ">"
