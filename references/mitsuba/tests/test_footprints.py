"""Ray differentials and the filters that average over them (model §10), compared with finite
differences of rays and with loops over texels.
"""

import itertools
import math
import os
import tempfile

import numpy as np

from support import Case, film
from whitstone_mitsuba import cameras, document, driver, footprints, pyramid, scene
from whitstone_mitsuba.images import srgb_to_linear
from whitstone_mitsuba.runtime import mi
from whitstone_mitsuba.settings import Setting

LOOK = "look_at = { origin = [1, 2, 5], target = [0.2, 0.1, 0] }"
AMBIENT = '[[light]]\ntype = "ambient"\nradiance = 1\n'


def unit(v):
    return v / np.linalg.norm(v)


def rays(camera, x, y, point):
    """Origins and directions of camera rays."""
    o, d = camera.formula(x, y, point)
    return np.stack([o + camera.starts(d) * d, d], axis=1).transpose(2, 1, 0)


def mean(picture, half_axes, place):
    """The mean over an ellipse around a place, by loops; lengths in units of the picture. The first
    axis repeats in mirror images, the second repeats.
    """
    h, w = picture.shape[:2]
    if (h, w) == (1, 1):
        return picture[0, 0]
    axes = [axis * [w, h] for axis in half_axes]
    axes = np.array([axis * max(1, 1 / np.linalg.norm(axis)) for axis in axes])
    middle = place * [w, h] - 0.5
    total, weights = np.zeros(3), 0
    for j, i in itertools.product(range(-60, 90), range(-60, 90)):
        x, y = np.linalg.solve(axes.T, np.array([i, j]) - middle)
        d = x * x + y * y
        if d < 1:
            x = 1 - d
            weight = x * (0.3053604 + x * (0.3825704 + x * (0.0182518 + 0.2935583 * x)))
            column = i % (2 * w) if i % (2 * w) < w else 2 * w - 1 - i % (2 * w)
            total, weights = total + weight * picture[j % h, column], weights + weight
    return total / weights


class Cameras(Case):
    def test_derivatives(self):
        for keys in (
            'type = "perspective"\nfov = 70\nnear = 0.5',
            'type = "perspective"\nwindow = { l = -0.2, r = 1, b = -0.3, t = 0.4, d = 0.7 }\nnear = 0.5\nnear_kind = "spherical"',
            'type = "orthographic"\nwidth = 3\nnear = -2',
            'type = "environment"',
            'type = "thin_lens"\naperture = 0.3\nfocus_distance = 4\nlens_samples = 3',
        ):
            errors = []
            table = document.tomllib.loads(f"{keys}\n{LOOK}")
            camera = cameras.read(table, 12, 8, errors, errors)
            self.assertEqual(errors, [])
            x, y, point = np.array([0.3, 7.1, 11.0]), np.array([0.1, 3.3, 7.9]), np.array([0, 4, 7])
            found = footprints.of_camera(camera, x, y, point, 0.5)
            h = 1e-4
            for side, (dx, dy) in enumerate(((h, 0), (0, h))):
                expected = (rays(camera, x + dx, y + dy, point) - rays(camera, x - dx, y - dy, point)) / (2 * h) * 0.5
                self.near(found[:, side], expected, rel=1e-6, atol=1e-8)


class Chains(Case):
    """A plane seen in a mirroring or refracting ball: finite differences of (u, v), from rays in
    double precision, compared with the driver's derivatives.
    """

    CENTER, RADIUS = np.array([0.3, 1.2, 0.4]), 1.1

    def hit(self, o, d):
        start = o - self.CENTER
        b, c = start @ d, start @ start - self.RADIUS**2
        roots = [-b - math.sqrt(b * b - c), -b + math.sqrt(b * b - c)]
        t = min(root for root in roots if root > 1e-6)
        return o + t * d, unit(start + t * d)

    @staticmethod
    def refract(d, n, eta):
        v, n = -d, n if n @ d < 0 else -n
        c = n @ v
        return (eta * c - math.sqrt(1 - eta**2 * (1 - c * c))) * n - eta * v

    def seen(self, camera, x, y, kind):
        """(u, v) on the plane y = 0, which are (x, -z)."""
        o, d = (row[:, 0] for row in camera.formula(np.array([x]), np.array([y])))
        p, n = self.hit(o, d)
        if kind == "mirror":
            d = d - 2 * (d @ n) * n
        else:
            d = self.refract(d, n, 1 / 1.4)
            p, n = self.hit(p, d)
            d = self.refract(d, n, 1.4)
        t = -p[1] / d[1]
        self.assertGreater(t, 0)
        return np.array([p[0] + t * d[0], -p[2] - t * d[2]])

    def test_branches(self):
        picture = '{ type = "image", file = "t.png", filter = "ewa" }'
        with tempfile.TemporaryDirectory() as base:
            mi.Bitmap(np.zeros((2, 2, 3), dtype=np.uint8)).write(os.path.join(base, "t.png"))
            for kind, material, path in (
                ("mirror", '{ type = "mirror" }', "R"),
                ("glass", '{ type = "dielectric", interior_ior = 1.4 }', "TT"),
                ("glass", '{ type = "whitted", k_refr = 1, interior_ior = 1.4 }', "TT"),
                ("glass", '{ type = "dielectric", interior_ior = 1.4, priority = 3 }', "TT"),
                ("glass", '{ type = "mix", a = { type = "mirror" }, b = { type = "dielectric", interior_ior = 1.4 } }', "TT"),
                ("mirror", '{ type = "conductor", metal = "Au" }', "R"),
            ):
                text = film(8, 8) + f'[camera]\ntype = "perspective"\n{LOOK}\nfov = 20\n' + AMBIENT + (
                    '[[shape]]\ntype = "plane"\ntransform = { rotate = { axis = [1, 0, 0], degrees = -90 } }\n'
                    f'material = {{ type = "matte", reflectance = {picture} }}\n'
                    f'[[shape]]\ntype = "sphere"\ncenter = {self.CENTER.tolist()}\nradius = {self.RADIUS}\nmaterial = {material}\n'
                )
                read = document.parse(text, base)
                self.assertTrue(read.footprints)
                tracer = driver.Tracer(scene.Built(read, Setting()), [Setting()], record=True)
                x, y = (3, 1) if kind == "glass" else (2, 2)
                pixel = np.array([x]), np.array([y])
                tracer.trace(tracer.camera_rays(*pixel, np.array([0]), read.samples), 0)
                lane = 0
                for depth, letter in enumerate(path):
                    links = {link[0]: link for link in tracer.levels[depth].links}
                    _, parents, _, children, _ = links[letter]
                    lane = int(children[np.flatnonzero(parents == lane)[0]])
                found = tracer.levels[len(path)].footprint.uv[lane]
                h = 1e-4
                camera, x, y = read.camera, x + 0.5, y + 0.5
                right = (self.seen(camera, x + h, y, kind) - self.seen(camera, x - h, y, kind)) / (2 * h)
                below = (self.seen(camera, x, y + h, kind) - self.seen(camera, x, y - h, kind)) / (2 * h)
                self.near(found, [right, below], rel=2e-4, atol=1e-5)


class Shapes(Case):
    def test_texture_coordinates(self):
        """Differences of (u, v) between neighbouring pixels in a narrow view, compared with the
        derivatives at the middle pixel.
        """
        wall = '[[shape]]\ntype = "triangle"\nvertices = [[-9, -9, -1], [9, -9, -1.5], [0, 9, -2]]\n'
        for shape in (
            'type = "sphere"\nradius = 0.7\ntransform = { rotate = { axis = [1, 2, 0], degrees = 50 } }',
            'type = "plane"\ntransform = [{ scale = 2 }, { rotate = { axis = [1, 2, 0], degrees = 50 } }]',
            'type = "rectangle"\ntransform = [{ scale = [1, 2, 1] }, { rotate = { axis = [1, 2, 0], degrees = 20 } }]',
            'type = "disk"\ntransform = [{ scale = 2 }, { rotate = { axis = [1, 2, 0], degrees = 20 } }, { translate = [0.5, 0.3, 0] }]',
            'type = "box"\ntransform = [{ scale = 0.6 }, { rotate = { axis = [1, 2, 0], degrees = 20 } }]',
            'type = "triangle"\nvertices = [[-2, -1, 0], [2, -1, 1], [0, 2, -1]]\nuvs = [[0, 1], [2, 0], [1, 3]]',
        ):
            view = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0.2, 0.15, 5], target = [0.2, 0.15, 0] }\nwidth = 0.003\n'
            picture = '{ type = "image", file = "t.png", filter = "trilinear" }'
            text = film(3, 3) + view + AMBIENT + f'[[shape]]\n{shape}\nmaterial = {{ type = "matte", reflectance = {picture} }}\n' + wall
            level = self.levels(text)[0]
            uv, normal = (np.array(array).T.astype(np.float64) for array in (level.hits.uv, level.hits.n_s))
            for side, (after, before) in enumerate(((5, 3), (7, 1))):
                self.near(level.footprint.uv[4, side], (uv[after] - uv[before]) / 2, rel=1e-2, atol=1e-6)
                self.near(level.footprint.normal[4, side], (normal[after] - normal[before]) / 2, rel=1e-2, atol=1e-6)

    def levels(self, text):
        """The levels of the ray trees of 3 x 3 pixels; `t.png` is an image."""
        with tempfile.TemporaryDirectory() as base:
            mi.Bitmap(np.zeros((2, 2, 3), dtype=np.uint8)).write(os.path.join(base, "t.png"))
            read = document.parse(text, base)
            tracer = driver.Tracer(scene.Built(read, Setting()), [Setting()], record=True)
            y, x = np.divmod(np.arange(9), 3)
            tracer.trace(tracer.camera_rays(x, y, np.zeros(9, dtype=np.int64), read.samples), 0)
        return tracer.levels

    def test_branches_at_perturbed_normals(self):
        mirror = 'material = { type = "mirror" }'
        noise = '{ type = "noise", scale = 3, mapping = { projection = "solid" }, a = [0.2, 0.8, 0.9], b = [0.8, 0.3, 0.9] }'
        view = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0.2, 0.15, 5], target = [0.2, 0.15, 0] }\nwidth = 0.003\n'
        wall = '[[shape]]\ntype = "plane"\ntransform = { translate = [0, 0, 9] }\nmaterial = '
        wall += '{ type = "matte", reflectance = { type = "image", file = "t.png", filter = "trilinear" } }\n'
        for material in (
            f'type = "normal_map", map = {noise}, strength = 0.3',
            f'type = "normal_map", map = {noise}, axis = [1, 2, 0]',
            f'type = "bump", height = {noise}, scale = 0.05',
            f'type = "bump", vector_map = {noise}, scale = 0.2',
        ):
            text = film(3, 3) + view + AMBIENT + f'[[shape]]\ntype = "sphere"\nmaterial = {{ {material}, {mirror} }}\n' + wall
            rays = self.levels(text)[1].rays
            self.assertEqual(rays.real, 9)
            d = np.array(rays.d).T.astype(np.float64)
            for side, (after, before) in enumerate(((5, 3), (7, 1))):
                found, expected = rays.differentials[4, side, 1], (d[after] - d[before]) / 2
                self.assertGreater(np.linalg.norm(expected), 1e-3)
                self.near(found, expected, rel=1e-2, atol=1e-6)

    def test_refusals(self):
        with tempfile.TemporaryDirectory() as base:
            mi.Bitmap(np.zeros((2, 2, 3), dtype=np.uint8)).write(os.path.join(base, "t.png"))
            view = film() + f'[camera]\ntype = "orthographic"\n{LOOK}\n'
            matte = '{ type = "matte", reflectance = { type = "image", file = "t.png", filter = "ewa"%s } }'
            points = [[i, j, 0] for j in range(4) for i in range(4)]
            patch = f'[[shape]]\ntype = "patch"\npoints = {points}\nmaterial = '
            floor = '[[shape]]\ntype = "plane"\nmaterial = '
            self.refuse(view + patch + matte % "", "unsupported", "footprints", "'patch'", base=base)
            # A surface that neither has such a texture nor reflects needs no derivatives.
            self.value(view + floor + matte % "" + "\n" + patch + '{ type = "matte" }', base=base)
            self.refuse(view + floor + matte.replace("ewa", "trilinear") % ", max_anisotropy = 4", "scene", "max_anisotropy", base=base)
            self.refuse(view + floor + matte % ", max_anisotropy = 65", "scene", "max_anisotropy", base=base)


class Pyramids(Case):
    def setUp(self):
        self.random = np.random.default_rng(3)
        self.picture = self.random.random((7, 10, 3))

    def test_levels(self):
        found = pyramid.levels(self.picture)
        self.assertEqual([level.shape[:2] for level in found], [(7, 10), (3, 5), (1, 2), (1, 1)])
        # Each texel of a level is the mean of the finer level, upsampled so that its texels divide
        # evenly.
        for fine, coarse in itertools.pairwise(found):
            (h, w), (k, m) = fine.shape[:2], coarse.shape[:2]
            drawn = fine.repeat(k, axis=0).repeat(m, axis=1)
            self.near(coarse, drawn.reshape(k, h, m, w, 3).mean(axis=(1, 3)), rel=1e-12)
        self.near(found[-1][0, 0], found[-2].mean(axis=(0, 1)), rel=1e-12)

    def test_trilinear(self):
        table = pyramid.Pyramid(self.picture, ("repeat", "clamp"))
        place = np.array([[0.3, 0.6]])
        for m, shares in ((0.5, [1, 0, 0, 0]), (2, [0, 1, 0, 0]), (2**1.25, [0, 0.75, 0.25, 0]), (2**2.5, [0, 0, 0.5, 0.5]), (99, [0, 0, 0, 1])):
            steps = np.array([[[m / 10, 0], [0, 0.3 * m / 7]]])
            expected = sum(share * table.bilinear(level, place) for level, share in enumerate(shares))
            self.near(table.trilinear(place, steps), expected, rel=1e-9)
        for bad in (np.inf, np.nan):
            self.near(table.trilinear(place, np.full((1, 2, 2), bad)), table.levels[-1][0], rel=1e-12)
            self.near(table.ewa(place, np.full((1, 2, 2), bad), 16.0), table.levels[-1][0], rel=1e-12)

    def test_ewa(self):
        """The model's definition, evaluated for one lookup and one texel at a time."""
        wraps = ("mirror", "repeat")
        table = pyramid.Pyramid(self.picture, wraps)
        q = math.exp(-2)
        r = math.sqrt((1 - 3 * q) / (3 * (1 - 5 * q)))
        place = self.random.random((60, 2)) * 4 - 1
        steps = self.random.normal(size=(60, 2, 2)) * 2.0 ** self.random.uniform(-5, 0, (60, 1, 1))
        steps[:20, 1] = steps[:20, 0] * self.random.uniform(-0.1, 0.1, (20, 1))
        found = table.ewa(place, steps, 5.0)
        for lane in range(60):
            s, t = steps[lane] * [10, 7] * r
            # Half axes: the directions in which the length of s cos a + t sin a is extreme.
            a = math.atan2(2 * s @ t, s @ s - t @ t) / 2
            one, other = s * math.cos(a) + t * math.sin(a), t * math.cos(a) - s * math.sin(a)
            A, B = np.linalg.norm(one), np.linalg.norm(other)
            self.assertGreaterEqual(A, B)
            across = np.array([-one[1], one[0]]) / A
            B = max(B, A / 5)
            other = across * B

            if A <= 1:
                expected = table.bilinear(0, place[lane : lane + 1])[0]
            else:
                x = min(max(0, math.log2(B)), len(table.levels) - 1)
                low = math.floor(x)
                means = [mean(picture, [axis / [10, 7] for axis in (one, other)], place[lane]) for picture in table.levels[low : low + 2]]
                expected = means[0] if x == low else (1 - x + low) * means[0] + (x - low) * means[1]
                if A < 2:
                    expected = (2 - A) * table.bilinear(0, place[lane : lane + 1])[0] + (A - 1) * expected
            self.near(found[lane], expected, rel=1e-9)

    def test_levels_in_images(self):
        """An image of 8 x 8 texels on two pixels: four texels per pixel, so level 2. With four
        sample positions per pixel: two texels per sample, so level 1.
        """
        texels = self.random.integers(0, 256, (8, 8, 3), dtype=np.uint8)
        table = pyramid.Pyramid(srgb_to_linear(texels / 255.0), ("clamp", "clamp"))
        view = film(2, 2) + '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n' + AMBIENT
        with tempfile.TemporaryDirectory() as base:
            mi.Bitmap(texels).write(os.path.join(base, "t.png"))
            for mapping in ("", ', mapping = { projection = "planar", transform = [{ translate = [1, 1, 0] }, { scale = 0.5 }] }'):
                picture = '{ type = "image", file = "t.png", wrap = "clamp", filter = "trilinear"%s }' % mapping
                wall = f'[[shape]]\ntype = "rectangle"\nmaterial = {{ type = "matte", reflectance = {picture} }}\n'
                self.near(self.value(view + wall, base=base), table.bilinear(2, np.array([[0.25, 0.25]]))[0], rel=1e-5)
                four = self.value(view + wall + '[sampler]\ntype = "grid"\nsamples_per_axis = 2\n', base=base)
                places = np.array(list(itertools.product((0.125, 0.375), (0.125, 0.375))))
                self.near(four, table.bilinear(1, places).mean(axis=0), rel=1e-5)
