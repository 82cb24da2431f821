"""Mipmap filters over footprints (model §10, *Levels*, *Trilinear*, *EWA*), in float64 on the host.
"""

from __future__ import annotations

from typing import Any, Callable, List, Tuple

import numpy as np

from . import footprints, mappings
from .runtime import mi

# Upper bound on texels that are weighted at once.
_AT_ONCE = 1 << 20

_Q = np.exp(-2.0)
# Half axes of the ellipse of a sample whose neighbours are one texel away.
RADIUS = float(np.sqrt((1 - 3 * _Q) / (3 * (1 - 5 * _Q))))


def _cover(many: int, few: int) -> np.ndarray:
    """(few, many): the overlap of each of `few` equal parts of a line with each of `many`, as
    fractions of the former.
    """
    edges, ends = np.arange(many + 1) / many, np.arange(few + 1) / few
    low = np.maximum(edges[None, :-1], ends[:-1, None])
    high = np.minimum(edges[None, 1:], ends[1:, None])
    return np.maximum(high - low, 0) * few


def _shrunk(values: np.ndarray, few: int) -> np.ndarray:
    """Averages along the first axis to `few` values."""
    if len(values) == 2 * few:
        return (values[0::2] + values[1::2]) / 2
    return np.tensordot(_cover(len(values), few), values, axes=1)


def levels(picture: np.ndarray) -> List[np.ndarray]:
    """The image and all coarser levels, down to a single texel."""
    found = [picture.astype(np.float64)]
    while found[-1].shape[:2] != (1, 1):
        height, width = found[-1].shape[:2]
        fewer_rows = _shrunk(found[-1], max(1, height // 2))
        found.append(np.swapaxes(_shrunk(np.swapaxes(fewer_rows, 0, 1), max(1, width // 2)), 0, 1))
    return found


def wrapped(place: np.ndarray, count: int, rule: str) -> np.ndarray:
    """The texels at integer positions, with the wrap mode applied."""
    if rule == "clamp":
        return np.clip(place, 0, count - 1).astype(np.int64)
    if rule == "repeat":
        return np.mod(place, count).astype(np.int64)
    folded = np.mod(place, 2 * count)
    return np.minimum(folded, 2 * count - 1 - folded).astype(np.int64)


class Pyramid:
    """An image with its mipmap levels."""

    def __init__(self, picture: np.ndarray, wrap: Tuple[str, str]) -> None:
        self.levels = levels(picture)
        self.wrap = wrap

    @property
    def size(self) -> np.ndarray:
        """Columns and rows."""
        return self._size(0)

    def _size(self, level: int) -> np.ndarray:
        return np.array(self.levels[level].shape[1::-1], dtype=np.float64)

    def _texels(self, level: int, column: np.ndarray, row: np.ndarray) -> np.ndarray:
        picture = self.levels[level]
        return picture[wrapped(row, picture.shape[0], self.wrap[1]), wrapped(column, picture.shape[1], self.wrap[0])]

    def bilinear(self, level: int, place: np.ndarray) -> np.ndarray:
        """Bilinear interpolation."""
        x = place * self._size(level) - 0.5
        low = np.floor(x)
        part = x - low
        total = np.zeros((len(place), 3))
        for corner in np.ndindex(2, 2):
            share = np.prod(np.where(np.array(corner) == 1, part, 1 - part), axis=1, keepdims=True)
            total += share * self._texels(level, low[:, 0] + corner[0], low[:, 1] + corner[1])
        return total

    def between(self, x: np.ndarray, of: Callable[[int, np.ndarray], np.ndarray]) -> np.ndarray:
        """Interpolates between levels; `of` gives the values of some lanes at a level. NaN counts
        as beyond the last level.
        """
        last = len(self.levels) - 1
        x = np.where(x < last, x, last)
        below = np.floor(x)
        total = np.zeros((len(x), 3))
        for level in range(last + 1):
            lanes = np.flatnonzero((below == level) | ((below == level - 1) & (x > below)))
            if len(lanes):
                share = 1 - np.abs(x[lanes] - level)
                total[lanes] += share[:, None] * of(level, lanes)
        return total

    def trilinear(self, place: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """`steps`: (n, 2, 2), to the neighbour on the right and to the one below."""
        with np.errstate(all="ignore"):
            longest = np.linalg.norm(steps * self.size, axis=2).max(axis=1)
            level = np.where(longest <= 1, 0.0, np.log2(longest))
        return self.between(level, lambda level, lanes: self.bilinear(level, place[lanes]))

    def ewa(self, place: np.ndarray, steps: np.ndarray, max_anisotropy: float) -> np.ndarray:
        """The mean over the ellipse of the sample."""
        finite = np.isfinite(steps).all(axis=(1, 2))
        axes, lengths = ellipse(np.where(finite[:, None, None], steps, 0.0) * self.size)
        longest, shortest = lengths.T
        shortest = np.maximum(shortest, longest / max_anisotropy)
        axes = axes * np.stack([longest, shortest], axis=1)[:, :, None]
        large = longest > 1
        total = np.zeros((len(place), 3))
        plain = np.flatnonzero(finite & (longest < 2))
        share = np.clip(2 - longest[plain], 0, 1)
        total[plain] = share[:, None] * self.bilinear(0, place[plain])
        wide = np.flatnonzero(finite & large)
        if len(wide):
            scale = np.log2(np.maximum(shortest[wide], 1))
            mean = self.between(scale, lambda level, lanes: self.elliptical(level, place[wide[lanes]], axes[wide[lanes]]))
            total[wide] += np.minimum(longest[wide] - 1, 1)[:, None] * mean
        total[~finite] = self.levels[-1][0, 0]
        return total

    def elliptical(self, level: int, place: np.ndarray, axes: np.ndarray) -> np.ndarray:
        """The weighted mean of the texels of a level in ellipses with these half axes (n, 2, 2), in
        texels of the image.
        """
        if level == len(self.levels) - 1:
            # A single texel, no matter how often the ellipse covers it.
            return np.broadcast_to(self.levels[level][0, 0], (len(place), 3))
        size = self._size(level)
        middle = place * size - 0.5
        axes = axes * (size / self.size)
        axes = axes * np.maximum(1 / np.linalg.norm(axes, axis=2, keepdims=True), 1)
        # The ellipse contains the points whose image under the inverse matrix lies in the unit
        # disk.
        inverse = np.linalg.inv(np.swapaxes(axes, 1, 2))
        reach = np.linalg.norm(axes, axis=1)
        total, weights = np.zeros((len(place), 3)), np.zeros(len(place))
        low, high = np.ceil(middle - reach), np.floor(middle + reach)
        counts = np.prod(high - low + 1, axis=1).astype(np.int64)
        # Process as many ellipses at a time as fit.
        ends = np.cumsum(counts)
        first = 0
        while first < len(place):
            last = max(first + 1, int(np.searchsorted(ends, (ends[first - 1] if first else 0) + _AT_ONCE, side="right")))
            lanes = np.repeat(np.arange(first, last), counts[first:last])
            index = np.arange(len(lanes)) - np.repeat(ends[first:last] - counts[first:last] - (ends[first - 1] if first else 0), counts[first:last])
            width = (high - low + 1)[lanes, 0].astype(np.int64)
            texel = low[lanes] + np.column_stack([index % width, index // width])
            d = np.sum(np.einsum("nij,nj->ni", inverse[lanes], texel - middle[lanes]) ** 2, axis=1)
            inside = d < 1
            lanes, texel, x = lanes[inside], texel[inside], 1 - d[inside]
            weight = x * (0.3053604 + x * (0.3825704 + x * (0.0182518 + 0.2935583 * x)))
            value = self._texels(level, texel[:, 0], texel[:, 1])
            weights += np.bincount(lanes, weight, minlength=len(place))
            for channel in range(3):
                total[:, channel] += np.bincount(lanes, weight * value[:, channel], minlength=len(place))
            first = last
        return total / weights[:, None]


def ellipse(steps: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Unit axes (n, 2, 2) and half lengths (n, 2), longest first, of the ellipses of samples with
    these steps (n, 2, 2) in texels.

    They come from the singular value decomposition of the matrix of both steps, which maps the unit
    circle to the ellipse.
    """
    _, lengths, axes = np.linalg.svd(steps)
    return axes, RADIUS * lengths


def project_step(projection: str, q: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(n, 2, 2): the derivatives of the point of texture space along steps (n, 2, 3) of the points
    (n, 3) before the projection.
    """
    q = q[:, None]
    if projection in ("uv", "solid", "planar"):
        return step[:, :, :2]
    if projection == "spherical":
        return footprints.sphere_step(q, step)
    if projection == "cylindrical":
        return np.stack([footprints.turn_step(q, step), step[:, :, 2]], axis=-1)
    assert projection == "cube"
    a = np.argmax(np.abs(q), axis=2)[:, :, None]
    m, towards = np.take_along_axis(q, a, 2), np.take_along_axis(step, a, 2)
    other = np.concatenate([(a + 1) % 3, (a + 2) % 3], axis=2)
    with np.errstate(all="ignore"):
        # (q_b/m + 1)/2 with m = |q_a|.
        ratio = np.take_along_axis(q, other, 2) / m
        return np.sign(m) * (np.take_along_axis(step, np.broadcast_to(other, step[:, :, :2].shape), 2) - ratio * towards) / (2 * m)


class Filtered(mi.Texture):
    """An image with a footprint filter as a Mitsuba texture."""

    def __init__(self, image: Any, whole: bool = False) -> None:
        mi.Texture.__init__(self, mi.Properties())
        # With `whole`, the footprint does not count, and the full resolution is looked up.
        self.image, self.whole = image, whole
        self.pyramid = Pyramid(image.pixels, image.wrap)

    def _over(self, points: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """(n, 3) colours at points of texture space, with the steps to the neighbours there."""
        scale = np.array(self.image.scale)
        place = points * scale + np.array(self.image.offset)
        # Rows count downwards, v upwards.
        place[:, 1] = 1 - place[:, 1]
        place = np.nan_to_num(place, nan=0.0, posinf=0.0, neginf=0.0)
        steps = steps * (scale * np.array([1.0, -1.0]))
        if self.image.filter == "trilinear":
            return self.pyramid.trilinear(place, steps)
        return self.pyramid.ewa(place, steps, float(self.image.max_anisotropy))

    def values(self, si: Any, place: Any) -> np.ndarray:
        """(n, 3) colours at `place`, which has `p`, `uv` and `sh_frame.n` like `si`, with the
        footprint of `si`.
        """
        mapping = self.image.mapping
        width = max(len(np.array(place.p[0])), len(np.array(place.uv[0])))

        def rows(array: Any) -> np.ndarray:
            found = np.array(array, dtype=np.float64).T
            return np.broadcast_to(found, (width, found.shape[1]))

        uv = mapping.projection == "uv"
        source, steps = (rows(place.uv), (si.duv_dx, si.duv_dy)) if uv else (rows(place.p), (si.dp_du, si.dp_dv))
        steps = np.stack([rows(step) for step in steps], axis=1)
        if self.whole:
            steps = np.zeros_like(steps)
        if mapping.uv_set == 1:
            # The second texture coordinates have no footprint.
            source, steps = np.broadcast_to(mappings.second_uv(place), (width, 2)), np.zeros_like(steps)
        if uv:
            source, steps = (np.concatenate([array, np.zeros_like(array[..., :1])], axis=-1) for array in (source, steps))
        linear = mapping.matrix[:3, :3]
        q = source @ linear.T + mapping.matrix[:3, 3]
        # Values that are not finite stay so.
        with np.errstate(invalid="ignore"):
            steps = steps @ linear.T
        if mapping.projection != "triplanar":
            return self._over(mappings.project(mapping.projection, q)[:, :2], project_step(mapping.projection, q, steps))
        total, weight = np.zeros((width, 3)), mapping.weights(rows(place.sh_frame.n))
        for a in range(3):
            plane = [(a + 1) % 3, (a + 2) % 3]
            total += weight[:, [a]] * self._over(q[:, plane], steps[:, :, plane])
        return total / weight.sum(axis=1, keepdims=True)

    def eval(self, si: Any, active: Any = True) -> Any:
        return mi.Color3f(np.ascontiguousarray(self.values(si, si).T.astype(np.float32)))

    def to_string(self) -> str:
        return f"Filtered[{self.image.filter}]"
