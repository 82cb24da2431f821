"""Twin of the texture `rings`: a function."""

from __future__ import annotations

from . import Fields, Texture
from .stripes import layers


def twin(fields: Fields) -> Texture:
    """See `layers`."""
    return layers(fields, lambda q: f"sqrt({q[0]}*{q[0]}+{q[2]}*{q[2]})")
