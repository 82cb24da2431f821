"""Images and their comparison."""

from __future__ import annotations

import base64
import html
import json
import os
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional, Union

from . import _native

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


def check_type(name: str, array: "npt.NDArray[Any]") -> None:
    """Checks that an array has real numbers: NumPy would convert what is none, such as dates."""
    if array.dtype.kind not in "fiu":
        raise TypeError(f"expected {name} of real numbers, found the type {array.dtype}")


class Image:
    """Linear radiance of shape (height, width, 3) in single precision, and layers."""

    def __init__(
        self,
        rgb: "npt.ArrayLike",
        layers: Optional[Mapping[str, "npt.NDArray[np.float32]"]] = None,
        statistics: Optional[Mapping[str, Any]] = None,
    ) -> None:
        import numpy as np

        array = np.asarray(rgb)
        check_type("an array", array)
        if array.dtype == np.uint8:
            raise TypeError("expected linear radiance, found 8-bit values, which are usually sRGB; convert them first")
        if array.ndim == 2:
            array = np.repeat(array[:, :, None], 3, axis=2)
        if array.ndim != 3 or array.shape[2] not in (3, 4):
            raise ValueError(
                f"expected an array of shape (height, width, 3), (height, width, 4) or (height, width), found {array.shape}"
            )
        #: Radiance in W/(m² sr), linear Rec. 709.
        self.rgb: "npt.NDArray[np.float32]" = np.ascontiguousarray(array[:, :, :3], dtype=np.float32)
        #: Layers by the name of their channel, each of shape (height, width).
        self.layers: Dict[str, "npt.NDArray[np.float32]"] = dict(layers or {})
        #: Samples, rays and times of the rendering.
        self.statistics: Dict[str, Any] = dict(statistics or {})

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.rgb.shape[1])

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.rgb.shape[0])

    @staticmethod
    def read(path: Union[str, "os.PathLike[str]"]) -> "Image":
        """Reads an OpenEXR file."""
        return Image(*_native.read_image(os.fspath(path)))

    def write(self, path: Union[str, "os.PathLike[str]"], *, exposure: float = 0.0) -> None:
        """Writes an OpenEXR file with all layers, or a PNG preview (`.png`)."""
        path = os.fspath(path)
        if path.lower().endswith(".png"):
            with open(path, "wb") as file:
                file.write(_native.png(self.rgb, exposure))
        elif path.lower().endswith(".exr"):
            attributes = {"scene_hash": self.statistics["scene_hash"]} if "scene_hash" in self.statistics else {}
            _native.write_image(path, self.rgb, self.layers, attributes)
        else:
            raise ValueError(f"{path}: expected a file name that ends in .exr or .png")

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> Any:
        import numpy as np

        if copy:
            return np.array(self.rgb, dtype=dtype)
        return np.asarray(self.rgb, dtype=dtype)

    def __repr__(self) -> str:
        layers = f", layers {', '.join(self.layers)}" if self.layers else ""
        return f"<whitstone.Image of {self.width} x {self.height} pixels{layers}>"

    def _repr_png_(self) -> bytes:
        return bytes(_native.png(self.rgb, 0.0))


#: An image, an array, a bitmap of Mitsuba, or the path of an OpenEXR file.
ImageLike = Any


def as_image(source: ImageLike) -> Image:
    """An image of anything that holds one."""
    if isinstance(source, Image):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Image.read(source)
    # Arrays, tensors and bitmaps of Mitsuba.
    return Image(source)


class Comparison:
    """The difference of two images."""

    def __init__(self, ours: Image, reference: Image, metrics: Mapping[str, Any]) -> None:
        self.ours = ours
        self.reference = reference
        #: All numbers by name, as ``whitstone compare --json`` writes them.
        self.metrics: Dict[str, Any] = dict(metrics)

    @property
    def rmse(self) -> float:
        """Root mean square difference, in units of radiance."""
        return float(self.metrics["rmse"])

    @property
    def rel_rmse(self) -> float:
        """Root mean square of the difference over |reference| plus its mean."""
        return float(self.metrics["rel_rmse_interior"] or 0.0)

    @property
    def max_abs(self) -> float:
        """Largest absolute difference."""
        return float(self.metrics["max_abs"])

    @property
    def pixels_over_tolerance(self) -> int:
        """Pixels whose difference exceeds the tolerance."""
        return int(self.metrics["pixels_over_tolerance"])

    @property
    def flip(self) -> Optional[float]:
        """Mean of FLIP, 0 (invisible) to 1; only with ``perceptual=True``."""
        return self.metrics.get("flip")

    @property
    def ssim(self) -> Optional[float]:
        """Structural similarity; only with ``perceptual=True``."""
        return self.metrics.get("ssim")

    @property
    def worst(self) -> List[Dict[str, Any]]:
        """The pixels with the largest relative difference."""
        return list(self.metrics["worst"])

    def __repr__(self) -> str:
        return (
            f"<whitstone.Comparison: rmse {self.rmse:.3g}, relative {self.rel_rmse:.3g}, "
            f"{self.pixels_over_tolerance} pixels over tolerance>"
        )

    def _repr_html_(self) -> str:
        return self.html()

    def html(self) -> str:
        """Both images under a slider, the error, and the numbers."""

        def picture(data: bytes) -> str:
            return "data:image/png;base64," + base64.b64encode(data).decode("ascii")

        ours, reference = picture(self.ours._repr_png_()), picture(self.reference._repr_png_())
        error = picture(bytes(_native.difference_png(self.ours.rgb, self.reference.rgb)))
        width = max(self.ours.width, 256)
        rows = [
            ("RMSE", f"{self.rmse:.4g}"),
            ("relative RMSE", f"{self.rel_rmse:.4g}"),
            ("largest difference", f"{self.max_abs:.4g}"),
            ("pixels over tolerance", str(self.pixels_over_tolerance)),
        ]
        rows += [(name.upper(), f"{number:.4g}") for name in ("flip", "ssim") if (number := self.metrics.get(name)) is not None]
        table = "".join(f"<tr><td>{html.escape(name)}</td><td>{html.escape(number)}</td></tr>" for name, number in rows)
        style = f"width:{width}px;image-rendering:pixelated;display:block"
        slide = "this.previousElementSibling.lastElementChild.style.clipPath='inset(0 0 0 '+this.value+'%)'"
        return (
            '<div style="display:flex;gap:12px;flex-wrap:wrap">'
            f'<figure style="margin:0"><div style="position:relative"><img alt="ours" src="{ours}" style="{style}">'
            f'<img alt="reference" src="{reference}" style="{style};position:absolute;top:0;left:0;clip-path:inset(0 0 0 50%)"></div>'
            f'<input type="range" min="0" max="100" value="50" style="width:{width}px" oninput="{slide}">'
            "<figcaption>ours | reference</figcaption></figure>"
            f'<figure style="margin:0"><img alt="relative error" src="{error}" style="{style}">'
            "<figcaption>relative error, 1e-6 to 1</figcaption></figure>"
            f"<table>{table}</table></div>"
        )


def compare(
    ours: ImageLike,
    reference: ImageLike,
    *,
    relative: float = 1e-3,
    absolute: float = 1e-4,
    perceptual: bool = False,
) -> Comparison:
    """Compares two images.

    Each is an :class:`Image`, an array of shape (height, width, 3), a bitmap of Mitsuba, or the path
    of an OpenEXR file. A pixel is over tolerance if a channel differs by more than ``relative``
    times the reference plus ``absolute`` times the mean of the reference. ``perceptual`` adds FLIP
    and SSIM.

    Raises ``ValueError`` if the sizes differ or a value is not finite, and ``TypeError`` for what
    holds no real numbers, or 8-bit values: they are usually not linear.

    >>> import numpy as np
    >>> grey = np.full((4, 4, 3), 0.5)
    >>> compare(grey, grey + 0.25).rmse
    0.25
    """
    first, second = as_image(ours), as_image(reference)
    found = _native.compare(first.rgb, second.rgb, relative, absolute, perceptual)
    return Comparison(first, second, json.loads(found))
