"""Prioritised (nested) dielectrics (model §8): the dominant medium in front of a face and behind
it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Sequence

import numpy as np

from .runtime import dr, mi
from .shaders import Branch

# The table index of the surroundings, outside of all bodies.
NONE = 64


@dataclass
class Face:
    """An interface at the hit points of rays."""

    # The bodies that contain the ray in front of the face and behind it, one bit each.
    before: Any
    behind: Any
    passed: Any
    # n_t/n_i.
    eta: Any
    # Absorption behind the face.
    absorption: Any

    def branch(self, letter: str, si: Any) -> Branch:
        """The delta branch of a kind; its weight is 0 where it does not exist."""
        r, cos_t, _, eta_ti = mi.fresnel(dr.abs(si.wi.z), self.eta)
        if letter == "R":
            return Branch(mi.Color3f(dr.select(self.passed, 0, r)), mi.reflect(si.wi))
        # `cos_t` holds for a viewer above.
        bent = mi.Vector3f(-eta_ti * si.wi.x, -eta_ti * si.wi.y, dr.select(si.wi.z < 0, -cos_t, cos_t))
        total = cos_t == 0
        weight = dr.select(self.passed, 1, dr.select(total, 0, (1 - r) * eta_ti * eta_ti))
        wo = dr.select(self.passed, -si.wi, bent)
        return Branch(mi.Color3f(weight), wo, self.passed, self.absorption, self.absorption, self.eta)

    def shadow(self, si: Any) -> Branch:
        """Transmittance of a filtered shadow ray, as seen from the side with the lower index."""
        r = mi.fresnel(dr.abs(si.wi.z), dr.maximum(self.eta, 1 / self.eta))[0]
        return Branch(mi.Color3f(dr.select(self.passed, 1, 1 - r)), None, self.passed, self.absorption, self.absorption)


class Bodies:
    """Tables by shape and by rank: the highest priority first, ties in the order of the document.
    """

    def __init__(self, shapes: Sequence[Any], materials: Sequence[Any]) -> None:
        ranked = [place for place, shape in enumerate(shapes) if materials[shape.material].priority is not None]
        ranked.sort(key=lambda place: (-materials[shapes[place].material].priority, place))
        bits = np.zeros(len(shapes) + 2, dtype=np.uint64)
        ior, absorption = np.ones(NONE + 1, dtype=np.float32), np.zeros((NONE + 1, 3), dtype=np.float32)
        for rank, place in enumerate(ranked):
            material = materials[shapes[place].material]
            bits[place] = np.uint64(1) << np.uint64(rank)
            ior[rank], absorption[rank] = material.numbers["interior_ior"], material.interior
        self._bits, self._ior = mi.UInt64(bits), mi.Float(ior)
        self._absorption = mi.Color3f(np.ascontiguousarray(absorption.T))
        dr.eval(self._bits, self._ior, self._absorption)

    def face(self, shape: Any, inside: Any, from_outside: Any) -> Face:
        """The faces of shapes with a priority, for rays that are inside the bodies `inside`."""
        bit = dr.gather(mi.UInt64, self._bits, shape)
        without, within = inside & ~bit, inside | bit
        before, behind = dr.select(from_outside, without, within), dr.select(from_outside, within, without)

        def top(bodies: Any) -> Any:
            return mi.UInt32(dr.select(bodies == 0, NONE, dr.tzcnt(bodies)))

        i, t = top(before), top(behind)
        eta = dr.gather(mi.Float, self._ior, t) / dr.gather(mi.Float, self._ior, i)
        return Face(before, behind, i == t, eta, dr.gather(mi.Color3f, self._absorption, t))
