"""Assertions for tests of renderers."""

from __future__ import annotations

import os
from typing import Optional, Union

from ._image import Comparison, Image, ImageLike, as_image, compare

#: Set by the option ``--whitstone-accept`` of pytest: references are written, not compared.
accept = False

#: The failed comparisons of this process, for the report of pytest.
failures: "list[tuple[str, Comparison]]" = []


def assert_image_matches(
    image: ImageLike,
    reference: Union[ImageLike, str, "os.PathLike[str]"],
    *,
    max_rel_rmse: float = 1e-3,
    max_pixels_over: int = 0,
    relative: float = 1e-3,
    absolute: float = 1e-4,
    name: Optional[str] = None,
) -> Comparison:
    """Raises ``AssertionError`` if an image differs from its reference.

    ``reference`` may be the path of an OpenEXR file. If the file does not exist, or to replace it,
    run pytest with ``--whitstone-accept``, and look at the file before you keep it.

    ``max_rel_rmse`` limits the relative root mean square error, and ``max_pixels_over`` the number
    of pixels that differ by more than the tolerance of :func:`whitstone.compare`.
    """
    ours = as_image(image)
    path = os.fspath(reference) if isinstance(reference, (str, os.PathLike)) else None
    label = name or path or "image"
    if path is not None and accept:
        os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
        ours.write(path)
        return compare(ours, ours)
    if path is not None and not os.path.exists(path):
        raise AssertionError(f"there is no reference {path}; run pytest with --whitstone-accept to write it")
    theirs = as_image(reference)
    if ours.rgb.shape != theirs.rgb.shape:
        raise AssertionError(
            f"{label}: the image has {ours.width} x {ours.height} pixels, the reference {theirs.width} x {theirs.height}"
        )
    _check_finite(ours, f"{label}: the image")
    _check_finite(theirs, f"{label}: the reference")
    found = compare(ours, theirs, relative=relative, absolute=absolute)
    problems = []
    if not found.rel_rmse <= max_rel_rmse:
        problems.append(f"relative RMSE {found.rel_rmse:.3g} is above {max_rel_rmse:.3g}")
    if found.pixels_over_tolerance > max_pixels_over:
        problems.append(f"{found.pixels_over_tolerance} pixels are over tolerance, {max_pixels_over} are allowed")
    if problems:
        failures.append((label, found))
        worst = found.worst[0]
        problems.append(
            f"the worst pixel is ({worst['x']}, {worst['y']}): {worst['ours']} instead of {worst['reference']}"
        )
        raise AssertionError(f"{label}: " + "; ".join(problems))
    return found


def _check_finite(image: Image, what: str) -> None:
    import numpy as np

    bad = np.argwhere(~np.isfinite(image.rgb).all(axis=2))
    if len(bad):
        y, x = bad[0]
        raise AssertionError(f"{what} has {len(bad)} pixels that are not finite, the first at ({x}, {y})")
