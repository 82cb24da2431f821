"""The rays of a level, their hits, and what the backward pass needs of both."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from . import footprints
from .lanes import pad
from .runtime import dr


@dataclass
class Rays:
    """The rays of a level, one lane each; all arrays are evaluated. `real` is the number of lanes
    without padding.
    """

    o: Any
    d: Any
    throughput: Any
    # Absorption per metre of the ray's medium.
    medium: Any
    # Hash of pixel and sample; hash of the path of branches; index of the setting.
    key: Any
    path: Any
    setting: Any
    # The facet that the ray leaves: see `spawn.Spawned`.
    left_shape: Any
    left_facet: Any
    left_within: Any
    left_push: Any
    # The prioritised dielectrics that the ray is in, one bit each.
    inside: Any
    real: int = 0
    # Ray differentials, (n, 2, 2, 3) float64 in NumPy: see `footprints`. None in documents without
    # textures that need them.
    differentials: Optional[np.ndarray] = None
    # States of the path classes, (n,) in NumPy: see `paths`. None if they are not asked for.
    states: Optional[np.ndarray] = None

    def arrays(self) -> List[Any]:
        return [
            self.o, self.d, self.throughput, self.medium, self.key, self.path, self.setting,
            self.left_shape, self.left_facet, self.left_within, self.left_push, self.inside,
        ]  # fmt: skip

    def gather(self, indices: np.ndarray) -> "Rays":
        """A subset of the rays, in the order of `indices`."""
        lanes = pad(indices)
        differentials = None if self.differentials is None else self.differentials[lanes.numpy()]
        taken = Rays(*[dr.gather(type(array), array, lanes) for array in self.arrays()])
        taken.real, taken.differentials = len(indices), differentials
        taken.states = None if self.states is None else self.states[lanes.numpy()]
        dr.eval(taken.arrays())
        return taken

    @staticmethod
    def concatenate(parts: Sequence["Rays"]) -> "Rays":
        """All rays of all parts."""
        if len(parts) == 1:
            return parts[0]

        def join(arrays: List[Any]) -> Any:
            kind = type(arrays[0])
            if dr.depth_v(kind) == 1:
                return dr.concat(arrays)
            return kind(*[dr.concat([array[axis] for array in arrays]) for axis in range(3)])

        joined = Rays(*[join(list(arrays)) for arrays in zip(*[part.arrays() for part in parts])])
        dr.eval(joined.arrays())
        if parts[0].differentials is not None:
            joined.differentials = np.concatenate([part.differentials for part in parts])
        if parts[0].states is not None:
            joined.states = np.concatenate([part.states for part in parts])
        return joined


@dataclass
class Hits:
    """The hits of a level, after rule S of the model; all arrays are evaluated."""

    valid: Any
    t: Any
    p: Any
    n_g: Any
    n_s: Any
    # n_s before rule S, for the AOV.
    n_raw: Any
    uv: Any
    shape: Any
    primitive: Any
    # The part of the surface that a ray cannot hit again right after it left it: a flat face, or a
    # whole sphere.
    facet: Any
    material: Any
    # Transmittance of the ray segment, and the throughput including it.
    transmittance: Any
    throughput: Any
    # The background on a miss; local terms are added here.
    local: Any
    rehit: Any


@dataclass
class Level:
    """The data of a level that the backward pass needs, and (for `tree`) the recorded details."""

    # None after the forward pass: see `release`.
    _rays: Optional[Rays]
    _hits: Optional[Hits]
    local: Any
    transmittance: Any
    footprint: Optional[footprints.Footprint] = None
    # Per branch letter: parents (lane here), weights, children (lane in the next level); children
    # are None at the depth limit.
    links: List[Tuple[str, np.ndarray, Any, Optional[np.ndarray], Any]] = field(default_factory=list)
    # Per lamp (lanes, visible, contribution); only when recording.
    lamps: List[Tuple[np.ndarray, int, Any, Any]] = field(default_factory=list)
    ambient: List[Tuple[np.ndarray, Any]] = field(default_factory=list)
    # With path classes: the local terms by the ends of their paths; then the local terms by class,
    # and for each link at the depth limit, whether its background is in each class.
    parts: Dict[str, Any] = field(default_factory=dict)
    split: List[Any] = field(default_factory=list)
    limits: List[Optional[np.ndarray]] = field(default_factory=list)

    @property
    def rays(self) -> Rays:
        """The rays of the level."""
        assert self._rays is not None, "used after the forward pass without recording"
        return self._rays

    @property
    def hits(self) -> Hits:
        """Their hits."""
        assert self._hits is not None, "used after the forward pass without recording"
        return self._hits

    def release(self) -> None:
        """Frees what the backward pass does not need."""
        self._rays = self._hits = self.footprint = None
