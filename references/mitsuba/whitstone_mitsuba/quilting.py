"""Image quilting and texture optimization (model §10, `synthesized`), in integers."""

from __future__ import annotations

from typing import List, Sequence, Tuple

import numpy as np

from .patterns import hash32


def _seam(d: np.ndarray) -> List[int]:
    """The path of least sum along the first axis; it moves by at most 1 per step across the second
    one.
    """
    sums = [d[0]]
    for row in d[1:]:
        padded = np.pad(sums[-1], 1, constant_values=np.iinfo(np.int64).max)
        sums.append(row + np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:]))
    path = [int(np.argmin(sums[-1]))]
    for row in sums[-2::-1]:
        low = max(path[-1] - 1, 0)
        path.append(low + int(np.argmin(row[low : path[-1] + 2])))
    return path[::-1]


def quilt(sample: np.ndarray, size: Tuple[int, int], block: int, overlap: int, tolerance: float, seed: int) -> np.ndarray:
    """(H, W, 3) codes, quilted from a sample of (h, w, 3)."""
    step = block - overlap
    columns, rows = (1 + -(-max(0, length - block) // step) for length in size)
    canvas = np.zeros(((rows - 1) * step + block, (columns - 1) * step + block, 3), dtype=np.int64)
    high, wide = sample.shape[0] - block + 1, sample.shape[1] - block + 1
    for r in range(rows):
        of_row = hash32(int(hash32(seed)) + r)
        for c in range(columns):
            old = canvas[r * step : r * step + block, c * step : c * step + block]
            errors = np.zeros((high, wide), dtype=np.int64)
            for j in range(block):
                for i in range(block):
                    if (c > 0 and i < overlap) or (r > 0 and j < overlap):
                        errors += ((sample[j : j + high, i : i + wide] - old[j, i]) ** 2).sum(axis=2)
            errors = errors.ravel()
            least = errors[errors > 0].min() if np.any(errors > 0) else 0
            candidates = np.flatnonzero(errors <= float(least) * (1.0 + tolerance))
            chosen = int(candidates[int(hash32(int(of_row) + c)) % len(candidates)])
            y, x = divmod(chosen, wide)
            piece = sample[y : y + block, x : x + block]
            d = ((piece - old) ** 2).sum(axis=2)
            new = np.ones((block, block), dtype=bool)
            if c > 0:
                new &= np.arange(block)[None, :] >= np.array(_seam(d[:, :overlap]))[:, None]
            if r > 0:
                new &= np.arange(block)[:, None] >= np.array(_seam(d[:overlap].T))[None, :]
            old[new] = piece[new]
    return canvas[: size[1], : size[0]]


# Upper bound on the numbers in a table of pieces: 64 MiB.
MOST_NUMBERS = 1 << 23


def _nearest(squares: np.ndarray, pieces: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """For each square, the index of the piece with the least sum of squared differences, and this
    sum; the lowest index wins ties.

    It uses matrix products in double precision. All sums are integers below 2^53, so they are exact
    in any order.
    """
    high, wide = pieces.shape[:2]
    squares = squares.astype(np.float64)
    own = (squares**2).sum(axis=1)
    best, chosen = np.full(len(squares), np.inf), np.zeros(len(squares), dtype=np.int64)
    rows = max(1, MOST_NUMBERS // (wide * squares.shape[1]))
    for first in range(0, high, rows):
        some = pieces[first : first + rows].reshape(-1, squares.shape[1]).astype(np.float64)
        for start in range(0, len(squares), 256):
            part = slice(start, start + 256)
            errors = own[part, None] + (some**2).sum(axis=1) - 2 * (squares[part] @ some.T)
            least = errors.argmin(axis=1)
            errors = errors[np.arange(len(least)), least]
            lower = errors < best[part]
            best[part] = np.where(lower, errors, best[part])
            chosen[part] = np.where(lower, first * wide + least, chosen[part])
    return chosen, best


def _weight(error: int) -> int:
    """The weight of a neighbourhood with this error."""
    root = int(float(error) ** 0.6)
    while root**5 > error**3:
        root -= 1
    while (root + 1) ** 5 <= error**3:
        root += 1
    return int(2**32 // max(1, root))


def _halved(fine: np.ndarray) -> np.ndarray:
    """The next coarser resolution of (H, W, 3) codes."""
    h, w = fine.shape[0] // 2, fine.shape[1] // 2
    return (fine[: 2 * h, : 2 * w].reshape(h, 2, w, 2, 3).sum(axis=(1, 3)) + 2) // 4


def at_all_resolutions(picture: np.ndarray, sample: np.ndarray, sides: Sequence[int], resolutions: int, iterations: int, robust: bool) -> np.ndarray:
    """(H, W, 3) codes after the iterations with all neighbourhoods at all resolutions."""
    samples, sizes = [sample], [picture.shape[:2]]
    for _ in range(resolutions - 1):
        samples.append(_halved(samples[-1]))
        picture = _halved(picture)
        sizes.append(picture.shape[:2])
    for sample, (height, width) in zip(samples[::-1], sizes[::-1]):
        if picture.shape[:2] != (height, width):
            rows = np.minimum(np.arange(height) // 2, picture.shape[0] - 1)
            picture = picture[rows][:, np.minimum(np.arange(width) // 2, picture.shape[1] - 1)]
        for side in sides:
            if side <= min(sample.shape[:2] + (height, width)):
                picture = optimized(picture, sample, side, iterations, robust)
    return picture


def optimized(picture: np.ndarray, sample: np.ndarray, side: int, iterations: int, robust: bool = False) -> np.ndarray:
    """(H, W, 3) codes after this number of iterations."""
    height, width = picture.shape[:2]
    pieces = np.lib.stride_tricks.sliding_window_view(sample, (side, side), axis=(0, 1))
    wide = pieces.shape[1]

    def starts(length: int) -> List[int]:
        return list(range(0, length - side, side // 4)) + [length - side]

    corners = [(y, x) for y in starts(height) for x in starts(width)]
    for _ in range(iterations):
        windows = [picture[y : y + side, x : x + side].transpose(2, 0, 1).ravel() for y, x in corners]
        sums, counts = np.zeros_like(picture), np.zeros((height, width, 1), dtype=np.int64)
        for (y, x), number, error in zip(corners, *_nearest(np.array(windows), pieces)):
            v, u = divmod(int(number), wide)
            weight = _weight(int(error)) if robust else 1
            sums[y : y + side, x : x + side] += weight * sample[v : v + side, u : u + side]
            counts[y : y + side, x : x + side] += weight
        picture = (2 * sums + counts) // (2 * counts)
    return picture
