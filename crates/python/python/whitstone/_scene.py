"""Scenes."""

from __future__ import annotations

import os
from typing import (
    TYPE_CHECKING,
    Any,
    Callable,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Tuple,
    Union,
)

from . import _native, _toml
from ._image import Image, check_type

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

#: A path, TOML text, or a dictionary with the tables of a scene.
Source = Union[str, "os.PathLike[str]", Mapping[str, Any]]


class Hits(NamedTuple):
    """The nearest hits of n rays."""

    #: Distances in metres, shape (n,); infinite for a miss.
    t: "npt.NDArray[np.float64]"
    #: Numbers of the shapes in the scene, shape (n,); -1 for a miss.
    shape: "npt.NDArray[np.int32]"
    #: Numbers of the primitives in the shapes, shape (n,).
    primitive: "npt.NDArray[np.uint32]"
    #: Numbers of the instances, shape (n,).
    instance: "npt.NDArray[np.uint32]"
    #: Surface parameters, shape (n, 2); for triangles the barycentric weights of the second and
    #: third vertex.
    uv: "npt.NDArray[np.float64]"


def _rays(
    origins: "npt.ArrayLike", directions: "npt.ArrayLike"
) -> Tuple["npt.NDArray[np.float64]", "npt.NDArray[np.float64]"]:
    """Checks arrays of rays."""
    import numpy as np

    def checked(name: str, source: "npt.ArrayLike") -> "npt.NDArray[np.float64]":
        array = np.asarray(source)
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"expected {name} of shape (n, 3), found {array.shape}")
        check_type(name, array)
        return np.ascontiguousarray(array, dtype=np.float64)

    origin, direction = checked("origins", origins), checked("directions", directions)
    if origin.shape != direction.shape:
        raise ValueError(
            f"expected as many directions as origins, found {origin.shape[0]} origins "
            f"and {direction.shape[0]} directions"
        )
    return origin, direction


def _check_not_negative(**numbers: Optional[int]) -> None:
    """The errors of the native module do not name the argument."""
    for name, number in numbers.items():
        if number is not None and number < 0:
            raise ValueError(f"expected {name} of at least 0, found {number}")


def _changes(changes: Mapping[str, Any]) -> List[str]:
    return [f"{path}={_toml.value(item)}" for path, item in changes.items()]


class Scene:
    """A scene that is built, and can be rendered any number of times.

    ``source`` is a file of any format that Whitstone reads, TOML text (recognised by a line break
    or an ``=``), or a dictionary with the same tables. ``changes`` maps paths of values such as
    ``"camera.fov"`` or ``"shape.0.radius"`` to other values. Paths in text and dictionaries are
    relative to ``base``. ``camera`` selects a camera of a file of another format, by name or index.

    A scene that needs more than ``max_memory`` bytes for meshes and accelerators is an error (by
    default: the available memory). So is a sample of a pixel that becomes more than
    ``max_tree_rays`` rays by reflection and refraction (by default: 1048576).

    Raises :class:`SceneError` with all that is wrong with the scene.

    >>> Scene({"film": {"width": 8, "height": 8}, "camera": {"type": "perspektive"}})
    Traceback (most recent call last):
    ...
    whitstone._errors.SceneError: error: unknown camera type "perspektive"...
    """

    def __init__(
        self,
        source: Source,
        changes: Optional[Mapping[str, Any]] = None,
        *,
        base: Union[str, "os.PathLike[str]"] = ".",
        camera: Optional[str] = None,
        max_memory: Optional[int] = None,
        max_tree_rays: Optional[int] = None,
    ) -> None:
        _check_not_negative(max_memory=max_memory, max_tree_rays=max_tree_rays)
        overrides = _changes(changes or {})
        #: The path, or the TOML text.
        self.source: Union[str, os.PathLike[str]]
        if isinstance(source, Mapping):
            source = _toml.document(source)
        self.is_file = not isinstance(source, str) or not ("\n" in source or "=" in source)
        self.source = source
        self.base = os.fspath(base)
        self.overrides = overrides
        self.camera = camera
        if self.is_file:
            self._native = _native.Scene.open(os.fspath(source), overrides, camera, max_memory, max_tree_rays)
        else:
            assert isinstance(source, str)
            self._native = _native.Scene.parse(source, self.base, overrides, max_memory, max_tree_rays)

    def with_(self, changes: Mapping[str, Any]) -> "Scene":
        """The same scene with other values of some keys."""
        more = _changes(changes)
        changed = object.__new__(Scene)
        changed.__dict__.update(self.__dict__)
        changed.overrides = self.overrides + more
        changed._native = self._native.with_(more)
        return changed

    @property
    def size(self) -> Tuple[int, int]:
        """Width and height of the image in pixels."""
        return self._native.size

    @property
    def files(self) -> List[str]:
        """The files that the scene was read from."""
        return self._native.files

    @property
    def warnings(self) -> List[str]:
        """What is unusual about the scene."""
        return self._native.warnings

    def render(
        self,
        *,
        threads: int = 0,
        region: Optional[Tuple[int, int, int, int]] = None,
        progress: Union[bool, Callable[[int, int], Any]] = False,
    ) -> Image:
        """Renders the image with all layers.

        ``threads``: 0 for one per core. ``region``: column, row, width and height of the part to
        render; its pixels have the values that they have in the whole image. ``progress``: True for
        a bar (by ``tqdm``, if it is installed), or a function of the finished and all pixels.
        Ctrl-C stops the rendering.
        """
        _check_not_negative(threads=threads)
        if region is not None and (len(region) != 4 or min(region) < 0):
            raise ValueError(f"expected a region of column, row, width and height of at least 0, found {region}")
        bar = None
        report: Optional[Callable[[int, int], Any]] = progress if callable(progress) else None
        if progress is True:
            bar = _bar("rendering")
            report = bar.update_to if bar is not None else None
        try:
            rgb, layers, statistics = self._native.render(threads, region, report)
        finally:
            if bar is not None:
                bar.close()
        return Image(rgb, layers, statistics)

    def pixel(self, x: int, y: int) -> Tuple[float, float, float]:
        """The radiance of one pixel in double precision; the image has it in single precision."""
        _check_not_negative(x=x, y=y)
        r, g, b = self._native.pixel(x, y)
        return r, g, b

    def trace(self, origins: "npt.ArrayLike", directions: "npt.ArrayLike") -> Hits:
        """The nearest hits of rays.

        ``origins`` and ``directions`` have the shape (n, 3). Directions need not be of unit length.
        The interpreter's lock is released, and all cores are used.

        >>> import numpy as np
        >>> camera = {"type": "perspective", "look_at": {"origin": [0, 0, 4], "target": [0, 0, 0]}}
        >>> scene = Scene({"camera": camera, "shape": [{"type": "sphere"}]})
        >>> scene.trace([[0, 0, 4], [0, 3, 4]], [[0, 0, -1], [0, 0, -2]]).t
        array([ 3., inf])
        """
        return Hits(*self._native.trace(*_rays(origins, directions)))

    def __repr__(self) -> str:
        width, height = self.size
        name = f"'{os.fspath(self.source)}'" if self.is_file else "from text"
        return f"<whitstone.Scene {name}, {width} x {height} pixels>"

    def _repr_png_(self) -> bytes:
        return self.render()._repr_png_()


def render(source: Union[Source, Scene], changes: Optional[Mapping[str, Any]] = None, **options: Any) -> Image:
    """Renders a scene: a path, TOML text, a dictionary or a :class:`Scene`.

    Options are those of :meth:`Scene.render`.
    """
    if isinstance(source, Scene):
        scene = source.with_(changes) if changes else source
    else:
        scene = Scene(source, changes)
    return scene.render(**options)


def _bar(what: str, unit: str = "px") -> Any:
    """A progress bar, if `tqdm` is installed."""
    try:
        from tqdm.auto import tqdm  # type: ignore[import-untyped]
    except ImportError:
        return None

    class Bar(tqdm):  # type: ignore[misc]
        def update_to(self, done: int, total: int) -> None:
            self.total = total
            self.update(done - self.n)

    return Bar(desc=what, unit=unit, leave=False)
