"""Bezier patches (model §9): positions, normals, and the error of their triangles, which falls
with the square of the level.
"""

import math
import unittest
from unittest import mock

import numpy as np
from support import Case, film

from whitstone_mitsuba import patches

HEIGHTS = np.array([[0.1, -0.5, 0.4, 0.0], [0.3, 0.6, -0.2, -0.4], [-0.3, 0.2, 0.5, 0.1], [0.0, -0.4, 0.3, 0.2]])


def wave():
    """Above the square from -1 to 1, x and y are linear in u and v, so the height has a closed
    form.
    """
    ends = [2 * k / 3 - 1 for k in range(4)]
    return [[float(x), float(y), float(HEIGHTS[i, j])] for i, y in enumerate(ends) for j, x in enumerate(ends)]


def binomial(x):
    """Bernstein's polynomials by their definition, and their derivatives."""
    value = [math.comb(3, k) * x**k * (1 - x) ** (3 - k) for k in range(4)]
    slope = [-3 * (1 - x) ** 2, 3 * (1 - x) ** 2 - 6 * x * (1 - x), 6 * x * (1 - x) - 3 * x**2, 3 * x**2]
    return np.array(value), np.array(slope)


def exact(x, y):
    """Height and unit normal of the wave."""
    (bu, du), (bv, dv) = binomial((x + 1) / 2), binomial((y + 1) / 2)
    normal = np.array([-(bv @ HEIGHTS @ du) / 2, -(dv @ HEIGHTS @ bu) / 2, 1.0])
    return bv @ HEIGHTS @ bu, normal / np.linalg.norm(normal)


def above(size, more):
    camera = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 3], target = [0, 0, 0] }\n'
    return film(size, size, ["depth", "normal", "uv", "primitive_id"]) + camera + "".join(more)


def shape(points, more=""):
    return f'[[shape]]\ntype = "patch"\npoints = {points}\n{more}'


class Patches(Case):
    size = 37

    def errors(self, level):
        """Root mean squares, of depths in metres and of unit normals."""
        with mock.patch.object(patches, "LEVEL", level), mock.patch.object(patches, "LEAST_LEVEL", 1):
            # Built scenes are cached by their text.
            channels, _ = self.render(above(self.size, [shape(wave(), f"# {level}\n")]))
        centres = (np.arange(self.size) + 0.5) / self.size * 2 - 1
        depth, turned = [], []
        for row, y in enumerate(-centres):
            for column, x in enumerate(centres):
                height, normal = exact(x, y)
                depth.append(3 - height - float(channels["depth.Z"][row, column]))
                found = np.array([float(channels[f"normal.{axis}"][row, column]) for axis in "XYZ"])
                turned.append(float(np.linalg.norm(found - normal)))
        return [math.sqrt(np.mean(np.square(errors))) for errors in (depth, turned)]

    def test_the_error_falls_with_the_square_of_the_level(self):
        levels = [16, 32, 64, 128]
        found = [self.errors(level) for level in levels]
        for name, column in (("depth", 0), ("normal", 1)):
            errors = [error[column] for error in found]
            slope = -np.polyfit(np.log(levels), np.log(errors), 1)[0]
            print(f"{name}: errors {', '.join(f'{error:.1e}' for error in errors)} at levels {levels}: slope {slope:.2f}")
            self.assertGreater(slope, 1.8)
            self.assertLess(slope, 2.2)

    def test_the_setting_vertices_varies_the_error(self):
        """The harness uses this setting to estimate the discretisation error of the reference: the
        estimate is close to the actual error.
        """
        channels, _ = self.render(above(self.size, [shape(wave())]))
        centres = (np.arange(self.size) + 0.5) / self.size * 2 - 1
        exactly = np.array([[3 - exact(x, y)[0] for x in centres] for y in -centres])
        error = np.sqrt(np.mean((channels["depth.Z"] - exactly) ** 2))
        for seed in (1, 2, 3):
            other, _ = self.render(above(self.size, [shape(wave())]), setting={"vertices": True, "seed": seed})
            moved = np.sqrt(np.mean((other["depth.Z"] - channels["depth.Z"]) ** 2))
            self.assertGreater(moved, error / 3)
            self.assertLess(moved, error * 3)

    def test_parameters_and_numbers(self):
        lower = [[x, y, z - 1] for x, y, z in wave()]
        both = f'[[shape]]\ntype = "patch"\nvertices = {lower + wave()}\npatches = {[list(range(16)), list(range(16, 32))]}\n'
        channels, _ = self.render(above(self.size, [both]))
        centres = (np.arange(self.size) + 0.5) / self.size
        self.near(channels["uv.U"], np.broadcast_to(centres[None, :], (self.size, self.size)), atol=1e-5)
        self.near(channels["uv.V"], np.broadcast_to(1 - centres[:, None], (self.size, self.size)), atol=1e-5)
        self.assertEqual(set(np.unique(channels["primitive_id.I"])), {1})

    def test_a_collapsed_edge_has_the_limit_normal(self):
        arc = [(1.0, 0.0), (1.0, 0.552), (0.552, 1.0), (0.0, 1.0)]
        for tip in (1.0, 0.7):
            rows = [(0.0, 1.0), (0.6, tip), (1.0, 0.55), (1.0, 0.0)]
            dome = np.array([[[r * x, r * y, z] for x, y in arc] for r, z in rows])
            steps = np.linspace(0, 1, 5)
            for points, u, v, near_u, near_v in (
                (dome, steps, np.array([0.0]), steps, np.array([1e-6])),
                (dome[::-1, ::-1], steps, np.array([1.0]), steps, np.array([1 - 1e-6])),
                (dome.transpose(1, 0, 2), np.array([0.0]), steps, np.array([1e-6]), steps),
            ):
                np.testing.assert_allclose(patches.normals(points, u, v), patches.normals(points, near_u, near_v), atol=1e-5)

    def test_invalid_patches_are_refused(self):
        for keys, word in (
            ("", "points"),
            ("points = [[0, 0, 0]]\n", "points"),
            (f"points = {wave()}\nvertices = {wave()}\n", "points"),
            (f"vertices = {wave()}\npatches = [[{', '.join(['16'] * 16)}]]\n", "patches"),
        ):
            self.refuse(above(1, ['[[shape]]\ntype = "patch"\n' + keys]), "scene", word)


if __name__ == "__main__":
    unittest.main()
