"""Hosted shapes, which the driver intersects, compared with closed forms (model §9)."""

import math
import unittest

import numpy as np

from support import Case, film
from whitstone_mitsuba import analytic, polynomials
from whitstone_mitsuba.hosted import Host
from whitstone_mitsuba.solids import DIFFERENCE, INTERSECTION, UNION, Solid
from whitstone_mitsuba.surfaces import (
    Ball,
    Box,
    Flat,
    HalfSpace,
    Lathe,
    Prism,
    Round,
    Start,
    Torus,
)

SKY = '[[light]]\ntype = "background"\nradiance = [0.2, 0.3, 0.4]\n'
LAMP = '[[light]]\ntype = "point"\nposition = {}\nintensity = 50\n'


def looking(origin, target, up=(0, 1, 0)):
    """A camera whose single pixel looks from `origin` to `target`."""
    origin, target, up = ([float(number) for number in vector] for vector in (origin, target, up))
    look = f"look_at = {{ origin = {origin}, target = {target}, up = {up} }}\n"
    return film() + '[camera]\ntype = "perspective"\n' + look


def shape(text, more=""):
    return f"[[shape]]\n{text}\n{more}\n"


def moved(x, y=0.0, z=0.0):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def line(surface, o, d, code=-1, outward=False):
    """[(t, step, code)] of the crossings of one line, in order."""
    vectors = [tuple(np.array([float(axis)]) for axis in vector) for vector in (o, d)]
    found = surface.crossings(*vectors, Start(np.array([code]), np.array([outward])))
    rows = [entry for entry in zip(found.t[0], found.step[0], found.code[0]) if entry[1] != 0 and entry[0] < math.inf]
    return sorted((float(t), int(step), int(part)) for t, step, part in rows)


class Polynomials(unittest.TestCase):
    def test_known_roots(self):
        """Products of (x - r) and of factors without real roots."""
        for roots, others in (([1, 2, 3, 4], []), ([-2, 5], [(1, 0.25)]), ([], [(1, 1), (-3, 3)]), ([0.5, 0.5 + 1e-7], [(0, 2)])):
            coefficients = np.array([1.0])
            for root in roots:
                coefficients = np.convolve(coefficients, [-root, 1.0])
            for middle, size in others:
                coefficients = np.convolve(coefficients, [middle * middle + size, -2 * middle, 1.0])
            columns = [np.array([value, value]) for value in coefficients]
            found, rising = polynomials.real_roots(columns, np.full(2, -10.0), np.full(2, 10.0))
            there = found[0][np.isfinite(found[0])]
            np.testing.assert_allclose(there, roots, rtol=1e-7)
            self.assertEqual(list(rising[0][: len(roots)]), [number % 2 == 1 for number in range(len(roots))])

    def test_random_roots(self):
        """No root is lost, even if two are close together."""
        random = np.random.default_rng(0)
        roots = np.sort(random.uniform(-1.3, 1.3, (3000, 4)), axis=1)
        roots[:500, 1] = roots[:500, 0] + 1e-5
        roots = np.sort(roots, axis=1)
        columns = list(np.array([np.poly(row)[::-1] for row in roots]).T)
        found, _ = polynomials.real_roots(columns, np.full(3000, -1.4), np.full(3000, 1.4))
        self.assertTrue(np.isfinite(found).all())
        self.assertLess(np.abs(found - roots).max(), 1e-8)

    def test_roots_outside_of_the_interval(self):
        found, _ = polynomials.real_roots([np.array([6.0]), np.array([-5.0]), np.array([1.0])], np.array([2.5]), np.array([9.0]))
        self.assertAlmostEqual(found[0][0], 3)
        self.assertTrue(math.isinf(found[0][1]))

    def test_lanes_do_not_depend_on_each_other(self):
        random = np.random.default_rng(1)
        columns = [random.normal(size=200) for _ in range(5)]
        low, high = np.full(200, -3.0), np.full(200, 3.0)
        together = polynomials.real_roots(columns, low, high)[0]
        for lane in range(0, 200, 17):
            alone = polynomials.real_roots([column[lane : lane + 1] for column in columns], low[:1], high[:1])[0]
            np.testing.assert_array_equal(alone[0], together[lane])


class Quadrics(Case):
    def test_points(self):
        """(shape, from, to, t, n_g, uv, primitive)."""
        s = math.sqrt(0.5)
        cylinder = 'type = "cylinder"\nradius = 2\nz = [-1, 3]'
        cone = 'type = "cone"\nradii = [2, 0]\nz = [0, 2]'
        cases = (
            (cylinder, (5, 5, 1), (0, 0, 1), math.sqrt(50) - 2, (s, s, 0), (0.125, 0.5), 0),
            (cylinder, (-5, 0, 0), (0, 0, 0), 3, (-1, 0, 0), (0.5, 0.25), 0),
            (cylinder, (0, 1, 9), (0, 1, 0), 6, (0, 0, 1), (0.5, 0.25), 2),
            (cylinder, (1, 0, -9), (1, 0, 0), 8, (0, 0, -1), (0.5, 0), 1),
            # From inside: the far side, and the cap from below.
            (cylinder, (0, 0, 1), (5, 0, 1), 2, (1, 0, 0), (0, 0.5), 0),
            (cylinder, (0, 1, 1), (0, 1, 5), 2, (0, 0, 1), (0.5, 0.25), 2),
            (cylinder + "\ncaps = false", (-0.5, 0, 9), (1.5, 0, 2), None, (1, 0, 0), (0, 0.3125), 0),
            (cone, (5, 0, 1), (0, 0, 1), 4, (s, 0, s), (0, 0.5), 0),
            (cone, (0, 1, -5), (0, 1, 0), 5, (0, 0, -1), (0.5, 0.25), 1),
            ('type = "ellipsoid"\nradii = [1, 2, 3]', (0, 9, 0), (0, 0, 0), 7, (0, 1, 0), (0.25, 0.5), 0),
            ('type = "ellipsoid"\nradii = [1, 2, 3]', (0, 0, 9), (0, 0, 0), 6, (0, 0, 1), (0, 1), 0),
            ('type = "paraboloid"\nradius = 2\nz = [0, 4]', (9, 0, 1), (0, 0, 1), 7, (2 / math.sqrt(8), 0, -2 / math.sqrt(8)), (0, 0.25), 0),
            ('type = "paraboloid"\nradius = 2\nz = [0, 4]', (2, 0, 9), (2, 0, 0), 5, (0, 0, 1), (0.5, 0), 2),
            ('type = "paraboloid"', (0, 0, -3), (0, 0, 0), 3, (0, 0, -1), (None, 0), 0),
            ('type = "hyperboloid"\nradius = 1\nslope = 2\nz = [-3, 1]', (0, -9, 0), (0, 0, 0), 8, (0, -1, 0), (0.75, 0.75), 0),
            ('type = "hyperboloid"\nradius = 1\nslope = 2\nz = [-3, 1]', (0, 1, 9), (0, 1, 0), 8, (0, 0, 1), (1 / math.sqrt(5), 0.25), 2),
        )
        for text, origin, target, t, n, uv, primitive in cases:
            up = (0, 1, 0) if origin[0] != target[0] or origin[2] != target[2] else (0, 0, 1)
            with self.subTest(text=text, origin=origin):
                node = self.nodes(looking(origin, target, up) + shape(text))[0]
                if t is not None:
                    self.near(node["t"], t)
                self.near(node["n_g"], n, atol=1e-6)
                for found, expected in zip(node["uv"], uv):
                    if expected is not None:
                        self.near(found, expected, atol=1e-6)
                self.assertEqual(node["primitive"], primitive)

    def test_open_and_bounded(self):
        """Without caps, a line along the axis hits nothing; beyond the ends there is nothing
        either.
        """
        tube = shape('type = "cylinder"\nradius = 1\nz = [0, 1]\ncaps = false')
        self.assertEqual(self.nodes(looking((0.5, 0, 5), (0.5, 0, 0)) + tube)[0]["shape"], -1)
        for z in (-0.01, 1.01):
            self.assertEqual(self.nodes(looking((5, 0, z), (0, 0, z)) + tube)[0]["shape"], -1)
        # Through the open end onto the inside.
        node = self.nodes(looking((0, 0, 2), (1, 0, 0.5)) + tube)[0]
        self.near([node["p"][0], node["p"][2]], [1, 0.5])
        self.near(node["n_g"], [1, 0, 0], atol=1e-6)

    def test_quadric_in_a_box(self):
        """A hyperbolic paraboloid z = x² - y², and a ball that is clipped to half by its box."""
        saddle = shape('type = "quadric"\ncoefficients = [1, -1, 0, 0, 0, 0, 0, 0, -1, 0]\ncaps = false')
        node = self.nodes(looking((0.5, 0.1, 5), (0.5, 0.1, 0)) + saddle)[0]
        self.near(node["t"], 5 - 0.24)
        # f grows downwards: the gradient (2x, -2y, -1).
        n = np.array([1, -0.2, -1])
        self.near(node["n_g"], n / np.linalg.norm(n))
        self.near(node["uv"], [0.75, 0.55])
        half = shape('type = "quadric"\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,-1]]\nbox = [[-1, -1, -1], [0.5, 1, 1]]')
        node = self.nodes(looking((5, 0.2, 0.3), (0, 0.2, 0.3)) + half)[0]
        self.near(node["t"], 4.5)
        self.assertEqual((node["primitive"], node["n_g"]), (2, [1, 0, 0]))
        self.assertEqual(node["uv"][0], 1)

    def test_transforms(self):
        """A mirrored, stretched cylinder keeps its outside; u follows the object's own axes."""
        text = shape('type = "cylinder"', "transform = [{ scale = [-2, 1, 3] }, { translate = [0, 0, 1] }]")
        node = self.nodes(looking((-9, 0, 1), (0, 0, 1)) + text)[0]
        self.near(node["t"], 7)
        self.near(node["n_g"], [-1, 0, 0], atol=1e-6)
        self.near(node["uv"], [0, 0.5], atol=1e-6)

    def test_errors(self):
        for text, word in (
            ('type = "cylinder"\nradius = 0', "radius"),
            ('type = "cone"\nradii = [0, 0]', "radii"),
            ('type = "paraboloid"\nz = [-1, 1]', "z0 >= 0"),
            ('type = "cylinder"\nz = [1, 1]', "z0 < z1"),
            ('type = "quadric"\ncoefficients = [0, 0, 0, 0, 0, 0, 0, 0, 0, 1]', "constant"),
            ('type = "quadric"\ncoefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, 1]', "no real points"),
            ('type = "quadric"\nmatrix = [[1,1,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,-1]]', "symmetric"),
            ('type = "torus"\nminor_radius = 2', "less than `major_radius`"),
            ('type = "torus"\ntransform = { scale = [1, 2, 1] }', "similarity"),
            ('type = "cylinder"\ncaps = 1', "true or false"),
        ):
            self.refuse(looking((0, 0, 5), (0, 0, 0)) + shape(text), "scene", word)


class TorusAndPolygon(Case):
    def test_torus(self):
        text = shape('type = "torus"\nmajor_radius = 2\nminor_radius = 0.5')
        for origin, target, t, n, uv in (
            ((9, 0, 0), (0, 0, 0), 6.5, (1, 0, 0), (0, 0)),
            ((0, 2, 9), (0, 2, 0), 8.5, (0, 0, 1), (0.25, 0.25)),
            # The inner side, from the centre; and from inside the tube.
            ((0, 0, 0), (-1, 0, 0), 1.5, (1, 0, 0), (0.5, 0.5)),
            ((0, -2, 0), (0, -9, 0), 0.5, (0, -1, 0), (0.75, 0)),
        ):
            up = (0, 0, 1) if target[0] == origin[0] else (0, 1, 0)
            up = (1, 0, 0) if target[:2] == origin[:2] else up
            node = self.nodes(looking(origin, target, up) + text)[0]
            self.near(node["t"], t)
            self.near(node["n_g"], n, atol=1e-6)
            # psi is at its seam at the outer rim.
            self.near(np.mod(np.array(node["uv"]) + 0.5, 1), np.mod(np.array(uv) + 0.5, 1), atol=1e-6)

    def test_all_four_crossings(self):
        torus = Torus(np.diag([2.0, 2, 2, 1]), 1.0, 0.25)
        found = line(torus, (-50, 0, 0), (1, 0, 0))
        np.testing.assert_allclose([entry[0] for entry in found], [47.5, 48.5, 51.5, 52.5], rtol=1e-13)
        self.assertEqual([entry[1] for entry in found], [1, -1, 1, -1])
        # From the second crossing: it is at 0, and the others do not move.
        found = line(torus, (-1.5, 0, 0), (1, 0, 0), 0, True)
        np.testing.assert_allclose([entry[0] for entry in found], [-1, 0, 3, 4], rtol=1e-12, atol=1e-14)
        self.assertEqual([entry[1] for entry in found], [1, -1, 1, -1])

    def test_polygon(self):
        """An arrow: points inside, its side, and texture coordinates along the axes that follow the
        largest axis of its normal.
        """
        text = shape('type = "polygon"\nvertices = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 0.5, 0], [0, 2, 0]]')
        node = self.nodes(looking((0.2, 1, 5), (0.2, 1, 0)) + text)[0]
        self.assertEqual((node["shape"], node["n_g"]), (0, [0, 0, 1]))
        self.near(node["uv"], [0.2, 1])
        self.assertEqual(self.nodes(looking((1, 1, 5), (1, 1, 0)) + text)[0]["shape"], -1)
        self.assertEqual(self.nodes(looking((2.1, 1, 5), (2.1, 1, 0)) + text)[0]["shape"], -1)
        head = looking((0, 0, 5), (0, 0, 0))
        for vertices in ("[[0,0,0],[1,1,0],[1,0,0],[0,1,0]]", "[[0,0,0],[1,0,0],[1,1,0.1],[0,1,0]]", "[[0,0,0],[1,0,0],[2,0,0]]"):
            self.refuse(head + shape(f'type = "polygon"\nvertices = {vertices}'), "scene", "vertices")
        self.assertFalse(analytic.edges_meet(np.array([[0, 0], [2, 0], [2, 2], [1, 0.5], [0, 2.0]])))
        self.assertTrue(analytic.edges_meet(np.array([[0, 0], [2, 0], [2, 2], [1, -0.5], [0, 2.0]])))


class PrismAndLathe(Case):
    def hits(self, text, cases):
        """(from, to, t, n_g, uv, primitive); None for a miss."""
        for origin, target, t, n, uv, primitive in cases:
            up = (0, 0, 1) if origin[0] == target[0] and origin[2] == target[2] else (0, 1, 0)
            with self.subTest(text=text, origin=origin):
                node = self.nodes(looking(origin, target, up) + shape(text))[0]
                if t is None:
                    self.assertEqual(node["shape"], -1)
                    continue
                self.near(node["t"], t)
                self.near(node["n_g"], n, atol=1e-6)
                self.near(node["uv"], uv, atol=1e-6)
                self.assertEqual(node["primitive"], primitive)

    def test_prism(self):
        """The letter U, in both senses; the outline is 12 long."""
        letter = [[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]]
        cases = (
            ((9, 2, 1.5), (0, 2, 1.5), 6, (1, 0, 0), (4.5 / 12, 0.5), 1),
            ((1.5, 2, 1.5), (9, 2, 1.5), 0.5, (-1, 0, 0), (6.5 / 12, 0.5), 3),
            ((1.5, 1.5, 9), (1.5, 1.5, 0), 8, (0, 0, 1), (7.5 / 12, 0.25), 4),
            ((0.5, 9, 1.5), (0.5, 0, 1.5), 6, (0, 1, 0), (1.5, 0.5), 9),
            ((0.5, -9, 1.5), (0.5, 0, 1.5), 10, (0, -1, 0), (1.5, 0.5), 8),
            ((1.5, 9, 1.5), (1.5, 0, 1.5), None, None, None, None),
            # Above it and below it.
            ((9, 3.1, 1.5), (0, 3.1, 1.5), None, None, None, None),
            ((9, 0.9, 1.5), (0, 0.9, 1.5), None, None, None, None),
            # From inside.
            ((0.5, 2, 1.5), (9, 2, 1.5), 0.5, (1, 0, 0), (8.5 / 12, 0.5), 5),
        )
        self.hits(f'type = "prism"\noutline = {letter}\ny = [1, 3]', cases)
        other = f'type = "prism"\noutline = {letter[::-1]}\ny = [1, 3]'
        self.hits(other, [((9, 2, 1.5), (0, 2, 1.5), 6, (1, 0, 0), (5.5 / 12, 0.5), 5)])
        self.hits(other, [((0.5, 9, 1.5), (0.5, 0, 1.5), 6, (0, 1, 0), (1.5, 0.5), 9)])

    def test_lathe(self):
        """A pot, in both senses, and an open funnel; the outline of the pot is 11 long."""
        pot = [[0, 0], [2, 0], [2, 4], [1, 4], [1, 1], [0, 1]]
        cases = (
            ((9, 3, 0), (0, 3, 0), 7, (1, 0, 0), (0.25, 5 / 11), 1),
            ((0, 3, -9), (0, 3, 0), 7, (0, 0, -1), (0.5, 5 / 11), 1),
            ((0, 3, 0), (-9, 3, 0), 1, (1, 0, 0), (0.75, 8 / 11), 3),
            ((0, 9, 1.5), (0, 0, 1.5), 5, (0, 1, 0), (0, 6.5 / 11), 2),
            ((0, 9, 0.5), (0, 0, 0.5), 8, (0, 1, 0), (0, 10.5 / 11), 4),
            ((0, -9, 1.5), (0, 0, 1.5), 9, (0, -1, 0), (0, 1.5 / 11), 0),
            ((0, 9, 2.5), (0, 0, 2.5), None, None, None, None),
        )
        self.hits(f'type = "lathe"\noutline = {pot}', cases)
        self.hits(f'type = "lathe"\noutline = {pot[::-1]}', [((9, 3, 0), (0, 3, 0), 7, (1, 0, 0), (0.25, 6 / 11), 3)])
        funnel = 'type = "lathe"\noutline = [[0, 0], [3, 4]]'
        self.hits(funnel, [((9, 2, 0), (0, 2, 0), 7.5, (0.8, -0.6, 0), (0.25, 0.5), 0)])
        self.hits(funnel, [((0, 9, 1.5), (0, 0, 1.5), 7, (0, -0.6, 0.8), (0, 0.5), 0)])
        self.hits(funnel.replace("[0, 0], [3, 4]", "[3, 4], [0, 0]"), [((9, 2, 0), (0, 2, 0), 7.5, (-0.8, 0.6, 0), (0.25, 0.5), 0)])

    def test_all_crossings(self):
        pot = Lathe(np.eye(4), np.array([[0, 0], [2, 0], [2, 4], [1, 4], [1, 1], [0, 1.0]]))
        found = line(pot, (-5, 2, 0), (1, 0, 0))
        np.testing.assert_allclose([entry[0] for entry in found], [3, 4, 6, 7], rtol=1e-13)
        self.assertEqual([entry[1:] for entry in found], [(1, 1), (-1, 3), (1, 3), (-1, 1)])
        # From the inner wall: that crossing is at 0.
        found = line(pot, (-1, 2, 0), (1, 0, 0), 3, True)
        np.testing.assert_allclose([entry[0] for entry in found], [-1, 0, 2, 3], rtol=1e-12, atol=1e-14)
        wedge = Prism(np.eye(4), np.array([[0, 0], [2, 0], [0, 2.0]]), (0.0, 1.0))
        found = line(wedge, (-1, 0.5, 0.5), (1, 0, 0))
        np.testing.assert_allclose([entry[0] for entry in found], [1, 2.5], rtol=1e-13)
        self.assertEqual([entry[1:] for entry in found], [(1, 2), (-1, 1)])

    def test_errors(self):
        for text, word in (
            ('type = "prism"\noutline = [[0, 0], [1, 0]]', "3 to 4096"),
            ('type = "prism"\noutline = [[0, 0], [1, 1], [1, 0], [0, 1]]', "intersect"),
            ('type = "prism"\noutline = [[0, 0], [1, 0], [2, 0], [1, 1e-12]]', "area"),
            ('type = "prism"\noutline = [[0, 0], [1, 0], [0, 1]]\ny = [1, 1]', "y0 < y1"),
            ('type = "lathe"\noutline = [[1, 0], [-1, 1]]', "at least 0"),
            ('type = "lathe"\noutline = [[1, 0], [0, 0], [0, 1]]', "on the axis"),
            ('type = "lathe"\noutline = [[1, 0], [2, 2], [2, 0], [1, 2]]', "intersect"),
            ('type = "csg"\noperation = "union"\noperands = [{ type = "sphere" }, { type = "lathe", outline = [[1, 0], [1, 1]] }]', "closed"),
        ):
            self.refuse(looking((0, 0, 5), (0, 0, 0)) + shape(text), "scene", word)


class Operations(unittest.TestCase):
    def setUp(self):
        self.balls = [Ball(np.eye(4)), Ball(moved(1))]

    def along(self, operation, operands=None):
        return [(t - 10, step) for t, step, _ in line(Solid(operation, operands or self.balls), (-10, 0, 0), (1, 0, 0))]

    def test_two_balls(self):
        self.assertEqual(self.along(UNION), [(-1, 1), (2, -1)])
        self.assertEqual(self.along(INTERSECTION), [(0, 1), (1, -1)])
        self.assertEqual(self.along(DIFFERENCE), [(-1, 1), (0, -1)])

    def test_names_and_sides(self):
        """Primitive numbers are p n + k, and the normals of a subtracted operand are flipped."""
        solid = Solid(DIFFERENCE, [Box(np.eye(4)), Ball(moved(1))])
        code = line(solid, (-10, 0, 0), (1, 0, 0))[1][2]
        found = solid.points(tuple(np.array([value]) for value in (0.0, 0.0, 0.0)), np.array([code]))
        self.assertEqual((float(found.n_g[0][0]), int(found.primitive[0])), (1, 1))
        code = line(solid, (-10, 0, 0), (1, 0, 0))[0][2]
        found = solid.points(tuple(np.array([value]) for value in (-1.0, 0.0, 0.0)), np.array([code]))
        self.assertEqual((float(found.n_g[0][0]), int(found.primitive[0])), (-1, 0))

    def test_results_without_volume_are_empty(self):
        """The union of adjacent boxes is one solid; their intersection, a face, is empty."""
        boxes = [Box(np.eye(4)), Box(moved(2))]
        self.assertEqual(self.along(UNION, boxes), [(-1, 1), (3, -1)])
        self.assertEqual(self.along(INTERSECTION, boxes), [])
        self.assertEqual(self.along(DIFFERENCE, boxes), [(-1, 1), (1, -1)])
        self.assertEqual(self.along(DIFFERENCE, [boxes[0], boxes[0]]), [])

    def test_half_spaces(self):
        """Lines may start inside, also for nested operations."""
        below, above = HalfSpace(np.eye(4)), HalfSpace(np.diag([1.0, 1, -1, 1]) @ moved(0, 0, 1))
        slab = Solid(INTERSECTION, [below, above])
        self.assertEqual([entry[:2] for entry in line(slab, (0, 0, 5), (0, 0, -1))], [(5, 1), (6, -1)])
        rest = Solid(DIFFERENCE, [Solid(UNION, [below, below]), Ball(np.eye(4))])
        found = line(rest, (0, 0, -5), (0, 0, 1))
        self.assertEqual([entry[:2] for entry in found], [(-math.inf, 1), (4, -1)])

    def test_rays_from_a_face(self):
        """From the surface of a cavity: the start is not a crossing ahead, the other side of the
        cavity is.
        """
        solid = Solid(DIFFERENCE, [Ball(np.diag([2.0, 2, 2, 1])), Ball(np.eye(4))])
        code = 1
        found = line(solid, (-1, 0, 0), (1, 0, 0), code, True)
        self.assertEqual([entry[:2] for entry in found], [(-1, 1), (0, -1), (2, 1), (3, -1)])


class Starts(unittest.TestCase):
    def test_grazing_rays_do_not_hit_their_start_again(self):
        """Starts that single precision moved off the surface, in directions within 1e-7 of the
        tangent plane.
        """
        random = np.random.default_rng(3)
        count = 2000
        surfaces = (
            Ball(np.eye(4)),
            Round(np.eye(4), (0.0, 0.0, 1.0), (-1.0, 1.0), True),
            Round(np.eye(4), (0.0, 0.5, 0.0), (0.0, 1.0), True),
        )
        for surface in surfaces:
            phi, z = random.uniform(0, 2 * np.pi, count), random.uniform(0.1, 0.9, count)
            ring = np.sqrt(np.maximum(surface.a[2, 2] * -z * z - 2 * surface.b[2] * z - surface.c, 0))
            p = np.array([ring * np.cos(phi), ring * np.sin(phi), z]).astype(np.float32).astype(np.float64)
            n = np.array(surface.half_gradient(tuple(p)))
            n /= np.linalg.norm(n, axis=0)
            across = np.cross(n.T, random.normal(size=(count, 3))).T
            across /= np.linalg.norm(across, axis=0)
            d = across + n * random.uniform(0, 1e-7, count)
            host = Host([(0, surface)], 1)
            facet = np.ones(count, dtype=np.int64)
            found = host.nearest(p, d, (np.zeros(count, dtype=np.int64), facet))
            self.assertEqual(int(np.isfinite(found.t).sum()), 0)
            # If the start is unknown, many of them re-hit the surface.
            blind = host.nearest(p, d, (np.ones(count, dtype=np.int64), facet))
            self.assertGreater(int(np.isfinite(blind.t).sum()), count // 10)


class Shading(Case):
    def test_twins(self):
        camera = looking((0, 0, 5), (0, 0, 0))
        _, answer = self.render(camera + shape('type = "cylinder"'))
        self.assertEqual((answer["twin"], [entry["type"] for entry in answer["hosted"]]), ("hosted", ["cylinder"]))
        _, answer = self.render(camera + shape('type = "sphere"'))
        self.assertEqual((answer["twin"], answer["hosted"]), ("native", []))

    def test_open_cylinders_are_native(self):
        """Open cylinders are native unless an instance stretches them. Their hit points have double
        precision, also far away and mirrored.
        """
        placed = "transform = [{ scale = -0.5 }, { rotate = { axis = [1, 2, 0], degrees = 50 } }]"
        tube = shape('type = "cylinder"\ncaps = false\nradius = 0.8\nz = [-1, 2]', placed)
        scene = film(24, 24, ("normal", "uv", "depth"))
        scene += '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 60, 80], target = [0, 0, 0] }\nfov = 1.2\n'
        scene += LAMP.format([20, 60, 10])
        found, answer = self.render(scene + tube)
        self.assertEqual((answer["twin"], answer["hosted"], answer["rehits"]), ("native", [], 0))
        instances = tube.replace("[[shape]]", "[[group.g.shape]]") + shape('type = "instance"\ngroup = "g"', "transform = { scale = [1, 1, {}] }")
        expected, answer = self.render(scene + instances.replace("{}", "1.000000002"))
        self.assertEqual([entry["type"] for entry in answer["hosted"]], ["cylinder"])
        self.assertGreater((found["depth.Z"] > 0).sum(), 100)
        for name, values in expected.items():
            # At most two pixels at rims and edges of the shadow.
            off = np.abs(found[name] - values) > 2e-6 * (1 + np.abs(values))
            self.assertLessEqual(off.sum(), 2, name)

    def test_an_ellipsoid_of_equal_radii_is_a_sphere(self):
        """Absorbing glass with a shadow: the same image, up to the rounding of Mitsuba's sphere.
        """
        scene = film(24, 24) + (
            '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 3, 4], target = [0, 0.5, 0] }\n'
            '[integrator]\ntype = "whitted"\nshadows = "filtered"\n'
        )
        scene += SKY + LAMP.format([2, 6, 1]) + shape('type = "rectangle"', "transform = [{ rotate = { axis = [1, 0, 0], degrees = -90 } }, { scale = 3 }]")
        glass = 'material = { type = "dielectric", absorption = [1, 0.5, 0.2] }\ntransform = { translate = [0, 1.01, 0] }'
        ours, answer = self.render(scene + shape('type = "ellipsoid"\nradii = [1, 1, 1]', glass))
        theirs, _ = self.render(scene + shape('type = "sphere"', glass))
        self.assertEqual(answer["rehits"], 0)
        for channel in "RGB":
            difference = np.abs(ours[channel] - theirs[channel]) / (0.05 + theirs[channel])
            self.assertLess(np.sort(difference.ravel())[-3], 3e-5)

    def test_glass_slab(self):
        """In through one cap and out through the other: each reflects 4 % at normal incidence; the
        transmittance between them is exp(-a t).
        """
        slab = shape('type = "cylinder"\nz = [0, 2]', 'material = { type = "dielectric", absorption = 0.5 }')
        found = self.value('[integrator]\ntype = "whitted"\nmax_depth = 40\n' + looking((0.2, 0.1, 9), (0.2, 0.1, 0)) + SKY + slab)
        r, inner = 0.04, math.exp(-1)
        sky = np.array([0.2, 0.3, 0.4])
        through = (1 - r) ** 2 * inner / (1 - (r * inner) ** 2)
        back = r + (1 - r) ** 2 * r * inner * inner / (1 - (r * inner) ** 2)
        self.near(found, sky * (through + back), rel=1e-5)

    def test_shadows(self):
        """A torus casts a shadow below its tube, not below its hole; one of glass transmits a part.
        """
        floor = shape('type = "rectangle"', "transform = { scale = 9 }\nmaterial = { type = \"matte\" }")
        ring = 'type = "torus"\nmajor_radius = 2\nminor_radius = 0.5'
        high = "transform = { translate = [0, 0, 1] }"
        for x, hidden in ((0, False), (2, True), (2.7, False)):
            camera = looking((x, -3, 0.2), (x, 0, 0), (0, 0, 1))
            lamp = "[[light]]\ntype = \"directional\"\ndirection = [0, 0, -1]\nirradiance = 2\n"
            value = self.value(camera + lamp + floor + shape(ring, high))
            self.near(value, 0 if hidden else 0.5 / math.pi * 2, atol=1e-6)
        filtered = '[integrator]\ntype = "whitted"\nshadows = "filtered"\n'
        value = self.value(filtered + looking((2, -3, 0.2), (2, 0, 0), (0, 0, 1)) + lamp + floor + shape(ring, high + '\nmaterial = { type = "dielectric" }'))
        self.near(value, 0.96 * 0.96 / math.pi, rel=1e-5)

    def test_ties(self):
        """At equal distance the shape with the lower number wins, if no other rule applies."""
        flat = shape('type = "rectangle"')
        # Caps of quadrics are not covered by the rule for coincident surfaces.
        cap = shape('type = "quadric"\ncoefficients = [1, 1, 0, 0, 0, 0, 0, 0, 0, -1]\nbox = [[-2, -2, -1], [2, 2, 0]]')
        camera = looking((0.25, 0.5, 4), (0.25, 0.5, 0))
        self.assertEqual(self.nodes(camera + flat + cap)[0]["primitive"], 0)
        self.assertEqual(self.nodes(camera + cap + flat)[0]["primitive"], 6)

    def test_stretched_and_sheared(self):
        """Instances that shear a disk and a plane do not change texture coordinates."""
        shear = "transform = { matrix = [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]] }"
        for kind, at in (("disk", (0.5, 0.25)), ("plane", (0.4, 0.6))):
            scene = f'[[group.g.shape]]\ntype = "{kind}"\n[[shape]]\ntype = "instance"\ngroup = "g"\n{shear}\n'
            x, y = (0.5, 0) if kind == "disk" else (0.4 + 0.3, 0.6)
            node = self.nodes(looking((x, y, 5), (x, y, 0)) + scene)[0]
            self.near(node["t"], 5)
            self.near(node["uv"], (0.5, 0) if kind == "disk" else at, atol=1e-6)
        # (1.2, 0.8) is the image of (0.8, 0.8), which is outside of the unit disk.
        self.assertEqual(self.nodes(looking((1.2, 0.8, 5), (1.2, 0.8, 0)) + scene.replace("plane", "disk"))[0]["shape"], -1)
        self.assertEqual(Flat(np.eye(4), "disk").bounds()[1], 1 + 1e-9)

    def test_probing_gives_the_same_bytes(self):
        text = 'type = "csg"\noperation = "difference"\noperands = [{ type = "torus" }, { type = "cone", radii = [1, 0.3] }]'
        scene = film(16, 12) + '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 2, 3], target = [0, 0, 0] }\n' + SKY
        scene += LAMP.format([2, 3, 4]) + shape(text, 'material = { type = "dielectric" }')
        channels, _ = self.render(scene)
        rows = self.ask("probe", scene, pixels=[[x, 6] for x in range(16)], settings=[{}])["values"][0]
        for x, row in enumerate(rows):
            self.assertEqual(row, [float(channels[channel][6, x]) for channel in "RGB"])
            self.assertEqual(row, list(self.value(scene, x, 6)))


if __name__ == "__main__":
    unittest.main()
