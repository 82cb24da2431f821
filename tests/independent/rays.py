"""Camera rays and triangles in double precision."""

from typing import Any, NamedTuple, Tuple

import numpy as np

from support import HEIGHT, WIDTH, View


class Hits(NamedTuple):
    """Nearest triangle of each pixel: its number or -1, its distance, and the smallest barycentric
    coordinate of the hit, which is 0 on an edge.
    """

    triangle: Any
    distance: Any
    margin: Any


def camera_rays(view: View, shift: float = 0.0) -> Tuple[Any, Any]:
    """Origins and unit directions through the pixel centres, row by row from the top, moved by
    `shift` pixels to the right.
    """
    left, right, bottom, top = view.window
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 + shift, np.arange(HEIGHT) + 0.5)
    a = (left + (right - left) * x / WIDTH)[..., None]
    c = (top - (top - bottom) * y / HEIGHT)[..., None]
    if view.orthographic:
        origins = view.origin + a * view.u + c * view.v
        directions = np.broadcast_to(-view.w, origins.shape)
    else:
        directions = a * view.u + c * view.v - view.w
        directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        origins = np.broadcast_to(view.origin, directions.shape)
    return origins.reshape(-1, 3), directions.reshape(-1, 3)


def pixel_boxes(view: View, triangles: Any) -> Any:
    """The pixels that each triangle may cover: first and last column, first and last row."""
    offset = triangles - view.origin
    a, c, depth = offset @ view.u, offset @ view.v, -(offset @ view.w)
    left, right, bottom, top = view.window
    behind = np.zeros(len(triangles), bool)
    if not view.orthographic:
        behind = (depth <= 1e-9 * np.abs(offset).max()).any(axis=1)
        depth = np.where(depth > 0, depth, 1.0)
        a, c = a / depth, c / depth
    x = (a - left) / (right - left) * WIDTH
    y = (top - c) / (top - bottom) * HEIGHT
    # A pixel more on each side, for shifted rays.
    box = np.stack([x.min(1) - 2, x.max(1) + 1, y.min(1) - 2, y.max(1) + 1], axis=1)
    box[behind] = [0, WIDTH, 0, HEIGHT]
    box = np.clip(np.floor(box), -1e6, 1e6).astype(np.int64)
    box[:, 0], box[:, 2] = box[:, 0].clip(0), box[:, 2].clip(0)
    box[:, 1], box[:, 3] = box[:, 1].clip(None, WIDTH - 1), box[:, 3].clip(None, HEIGHT - 1)
    return box


def intersect(origins: Any, directions: Any, triangles: Any) -> Tuple[Any, Any]:
    """Distance of each ray to the triangle of the same number, infinite if it misses, and the
    smallest barycentric coordinate (Moeller and Trumbore 1997).
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    first, second, across = b - a, c - a, np.cross(directions, c - a)
    determinant = (first * across).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / determinant
        offset = origins - a
        p = (offset * across).sum(1) * inverse
        up = np.cross(offset, first)
        q = (directions * up).sum(1) * inverse
        distance = (second * up).sum(1) * inverse
        margin = np.minimum(np.minimum(p, q), 1 - p - q)
        inside = (determinant != 0) & (margin >= 0)
    return np.where(inside, distance, np.inf), margin


def trace(view: View, triangles: Any, shift: float = 0.0, pairs: int = 2_000_000) -> Hits:
    """The nearest triangle of each pixel. Every ray meets every triangle whose box has its pixel."""
    origins, directions = camera_rays(view, shift)
    box = pixel_boxes(view, triangles)
    columns, rows = (box[:, 1] - box[:, 0] + 1).clip(0), (box[:, 3] - box[:, 2] + 1).clip(0)
    counts = columns * rows
    nearest = np.full(WIDTH * HEIGHT, np.inf)
    margin = np.zeros(WIDTH * HEIGHT)
    number = np.full(WIDTH * HEIGHT, -1)
    near = view.near if view.orthographic else view.near / -(directions @ view.w)
    near = np.broadcast_to(near, nearest.shape)
    order = np.flatnonzero(counts)
    sums = np.cumsum(counts[order])
    start = 0
    while start < len(order):
        before = sums[start - 1] if start else 0
        end = max(start + 1, int(np.searchsorted(sums, before + pairs, "right")))
        some = order[start:end]
        triangle = np.repeat(some, counts[some])
        place = np.arange(len(triangle)) - np.repeat(np.cumsum(counts[some]) - counts[some], counts[some])
        pixel = (box[triangle, 2] + place // columns[triangle]) * WIDTH + box[triangle, 0] + place % columns[triangle]
        distance, inner = intersect(origins[pixel], directions[pixel], triangles[triangle])
        hit = np.isfinite(distance) & (distance > near[pixel])
        triangle, pixel, distance, inner = triangle[hit], pixel[hit], distance[hit], inner[hit]
        # The nearest of each pixel; of equal ones, the first triangle.
        sort = np.lexsort((triangle, distance, pixel))
        pixel, first = np.unique(pixel[sort], return_index=True)
        best = sort[first]
        closer = distance[best] < nearest[pixel]
        pixel, best = pixel[closer], best[closer]
        nearest[pixel], number[pixel], margin[pixel] = distance[best], triangle[best], inner[best]
        start = end
    shape = (HEIGHT, WIDTH)
    return Hits(number.reshape(shape), nearest.reshape(shape), margin.reshape(shape))


def same_around(values: Any) -> Any:
    """Whether all of the 3 x 3 pixels around a pixel have its value. False at the border."""
    equal = np.zeros(values.shape, bool)
    inner = values[1:-1, 1:-1]
    result = np.ones(inner.shape, bool)
    for i in range(3):
        for j in range(3):
            result &= values[i : i + inner.shape[0], j : j + inner.shape[1]] == inner
    equal[1:-1, 1:-1] = result
    return equal


def differences(values: Any) -> Tuple[Any, Any]:
    """Of each pixel: the largest difference to one of its 8 neighbours, and the largest distance
    from the mean of two opposite neighbours. Infinite at the border. `values` has channels last.
    """
    slope = np.full(values.shape[:2], np.inf)
    bend = np.full(values.shape[:2], np.inf)
    inner = values[1:-1, 1:-1]
    height, width = inner.shape[:2]

    def moved(i: int, j: int) -> Any:
        return values[1 + i : 1 + i + height, 1 + j : 1 + j + width]

    steps, bends = np.zeros(inner.shape[:2]), np.zeros(inner.shape[:2])
    for i, j in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one, other = moved(i, j), moved(-i, -j)
        for neighbour in (one, other):
            steps = np.maximum(steps, np.abs(neighbour - inner).max(-1))
        bends = np.maximum(bends, np.abs((one + other) / 2 - inner).max(-1))
    slope[1:-1, 1:-1], bend[1:-1, 1:-1] = steps, bends
    return slope, bend
