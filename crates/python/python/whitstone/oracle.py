"""The oracle: exact hits and pixels of a scene, to check a ray tracer against.

It computes in arbitrary precision, by code of its own. Numbers of a scene are taken as exactly the
doubles that they are. It is slow: every ray is tested against every shape.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, NamedTuple, Optional, Tuple, Union

from . import _native
from ._scene import Scene, Source, _bar, _rays

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


class ExactHits(NamedTuple):
    """The first hits of n rays."""

    #: Whether the oracle is certain, shape (n,). It is not where a ray touches a surface or meets
    #: two surfaces at one point; ``t`` is NaN there.
    certain: "npt.NDArray[np.bool_]"
    #: Distances in metres, shape (n,): the doubles nearest to the exact values; infinite for a miss.
    t: "npt.NDArray[np.float64]"
    #: Points, shape (n, 3); NaN where there is no hit.
    point: "npt.NDArray[np.float64]"
    #: Geometric normals of unit length, shape (n, 3); NaN where there is no hit.
    normal: "npt.NDArray[np.float64]"


class Oracle:
    """The oracle for a scene.

    Raises :class:`whitstone.SceneError` with every part of the scene that it does not support.
    """

    def __init__(self, scene: Union[Source, Scene]) -> None:
        if not isinstance(scene, Scene):
            scene = Scene(scene)
        self._native = _native.Oracle(scene._native)

    def trace(
        self,
        origins: "npt.ArrayLike",
        directions: "npt.ArrayLike",
        *,
        progress: Union[bool, Callable[[int, int], Any]] = False,
    ) -> ExactHits:
        """The first hits of rays, as for :meth:`whitstone.Scene.trace`.

        Directions are scaled to unit length in double precision first, as there.

        >>> camera = {"type": "perspective", "look_at": {"origin": [0, 0, 4], "target": [0, 0, 0]}}
        >>> oracle = Oracle({"camera": camera, "shape": [{"type": "sphere"}]})
        >>> oracle.trace([[0, 0, 4], [0, 3, 4], [0, 1, 4]], [[0, 0, -1]] * 3).t
        array([ 3., inf, nan])
        """
        bar = None
        report: Optional[Callable[[int, int], Any]] = progress if callable(progress) else None
        if progress is True:
            bar = _bar("tracing", unit="ray")
            report = bar.update_to if bar is not None else None
        try:
            return ExactHits(*self._native.trace(*_rays(origins, directions), report))
        finally:
            if bar is not None:
                bar.close()

    def pixel(self, x: int, y: int) -> Tuple[Tuple[float, float, float], Tuple[float, float, float]]:
        """The radiance of one pixel, and a bound on its error.

        Raises :class:`ValueError` with the reason where the oracle cannot decide.
        """
        return self._native.pixel(x, y)


def trace(scene: Union[Source, Scene], origins: "npt.ArrayLike", directions: "npt.ArrayLike", **options: Any) -> ExactHits:
    """The first hits of rays in a scene: :meth:`Oracle.trace`."""
    return Oracle(scene).trace(origins, directions, **options)
