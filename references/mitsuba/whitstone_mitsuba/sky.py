"""Directional lights that approximate an environment (model §7, sky light).

The integrand is constant on each cell. Its integral over a region follows from four values of a
summed-area table, which is bilinear inside a cell.
"""

from __future__ import annotations

from typing import Any, Callable, List, Optional, Sequence, Tuple

import numpy as np

COLUMNS, ROWS = 1024, 512
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

Region = Tuple[float, float, float, float]


def parts(radiance: Any, faces: Optional[Sequence[Any]] = None) -> int:
    """Number of lookups per cell along each axis: more than 1 for large images."""
    if faces is not None:
        return max(-(-faces[0].pixels.shape[0] // 512), 1)
    if not hasattr(radiance, "pixels"):
        return 1
    height, width = radiance.pixels.shape[:2]
    return max(-(-width // 2048), -(-height // 1024), 1)


class Integral:
    """Integral of (rows, columns, n) values per unit of `across` and `along`, functions of y and of
    phi.
    """

    def __init__(self, values: np.ndarray, y: np.ndarray, phi: np.ndarray, across: Callable[[Any], Any], along: Callable[[Any], Any]) -> None:
        self.y, self.phi, self.across, self.along = y, phi, across, along
        self.rows, self.columns = across(y), along(phi)
        cells = values * np.diff(self.rows)[:, None, None] * np.diff(self.columns)[None, :, None]
        self.sums = np.zeros((len(y), len(phi), values.shape[2]))
        self.sums[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)

    def row(self, y: float) -> np.ndarray:
        """The integral up to y, for each edge of a column."""
        index = min(max(int(np.searchsorted(self.y, y, "right")) - 1, 0), len(self.y) - 2)
        part = (self.across(y) - self.rows[index]) / (self.rows[index + 1] - self.rows[index])
        return self.sums[index] + part * (self.sums[index + 1] - self.sums[index])

    def column(self, phi: float, of: np.ndarray) -> np.ndarray:
        """The integral up to phi, given the values at each column edge (on the last axis but one).
        """
        index = min(max(int(np.searchsorted(self.phi, phi, "right")) - 1, 0), len(self.phi) - 2)
        part = (self.along(phi) - self.columns[index]) / (self.columns[index + 1] - self.columns[index])
        return of[..., index, :] + part * (of[..., index + 1, :] - of[..., index, :])

    def over(self, region: Region) -> np.ndarray:
        y_0, y_1, phi_0, phi_1 = region
        band = self.row(y_1) - self.row(y_0)
        return self.column(phi_1, band) - self.column(phi_0, band)


def _height(y: Any) -> Any:
    return (y * np.sqrt(np.maximum(1 - y * y, 0)) + np.arcsin(y)) / 2


def _same(x: Any) -> Any:
    return x


def _regions(weight: Integral, region: Region, k: int) -> List[Region]:
    if k == 1:
        return [region]
    y_0, y_1, phi_0, phi_1 = region
    nearest = 0.0 if y_0 < 0 < y_1 else min(abs(y_0), abs(y_1))
    first = k // 2
    if 0.65 * (phi_1 - phi_0) * np.sqrt(1 - nearest**2) > np.arcsin(y_1) - np.arcsin(y_0):
        edges = weight.phi
        sums = (weight.row(y_1) - weight.row(y_0))[:, 0]
        low, high = phi_0, phi_1
    else:
        edges = weight.y
        sums = (weight.column(phi_1, weight.sums) - weight.column(phi_0, weight.sums))[:, 0]
        low, high = y_0, y_1
    start, end = np.interp([low, high], edges, sums)
    cut = float(np.clip(np.interp(start + (end - start) * first / k, sums, edges), low, high))
    if edges is weight.phi:
        halves = (y_0, y_1, phi_0, cut), (y_0, y_1, cut, phi_1)
    else:
        halves = (y_0, cut, phi_0, phi_1), (cut, y_1, phi_0, phi_1)
    return _regions(weight, halves[0], first) + _regions(weight, halves[1], k - first)


def table(s: int, look: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """The radiance of all cells, from the lowest row and the first column on."""
    total = np.zeros((ROWS * COLUMNS, 3))
    for a in range(s):
        for b in range(s):
            u, v = (np.arange(COLUMNS) + (a + 0.5) / s) / COLUMNS, (np.arange(ROWS) + (b + 0.5) / s) / ROWS
            uv = np.column_stack([np.tile(u, ROWS), np.repeat(v, COLUMNS)])
            phi, latitude = 2 * np.pi * (uv[:, 0] - 0.5), np.pi * (uv[:, 1] - 0.5)
            level = np.cos(latitude)
            total += look(uv, np.column_stack([level * np.sin(phi), np.sin(latitude), -level * np.cos(phi)]))
    return (total / s**2).reshape(ROWS, COLUMNS, 3)


def directions(n: int, s: int, look: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Tuple[np.ndarray, np.ndarray]:
    """Directions and irradiances of the lights of `look`, a function of (n, 2) coordinates and
    (n, 3) directions.
    """
    radiance = table(s, look)
    most = radiance.max()
    if not most > 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    # Normalised, so that sums of the largest values stay finite.
    radiance = radiance / most
    y, phi = np.sin(np.pi * (np.arange(ROWS + 1) / ROWS - 0.5)), 2 * np.pi * (np.arange(COLUMNS + 1) / COLUMNS - 0.5)
    luminance = radiance @ LUMINANCE
    weight = luminance ** (4 / 7)
    weight += 0.01 * float(weight.mean(axis=1) @ np.diff(y)) / 2
    regions = _regions(Integral(weight[..., None], y, phi, _same, _same), (-1.0, 1.0, -np.pi, np.pi), 2 * n * n)

    energy = Integral(radiance, y, phi, _same, _same)
    bright = luminance[..., None]
    moments = (
        Integral(bright, y, phi, _height, lambda angle: -np.cos(angle)),
        Integral(bright, y, phi, lambda height: height * height / 2, _same),
        Integral(bright, y, phi, _height, lambda angle: -np.sin(angle)),
    )
    irradiance = np.maximum([energy.over(region) for region in regions], 0)
    moment = np.array([[float(part.over(region)[0]) for part in moments] for region in regions])
    # Black regions contain only rounding errors.
    lit = irradiance.max(axis=1) > 1e-13 * irradiance.max()
    length = np.linalg.norm(moment, axis=1, keepdims=True)
    directed = np.where(length > 0, moment / np.where(length > 0, length, 1), [0.0, 1.0, 0.0])
    return directed[lit], irradiance[lit] * most
