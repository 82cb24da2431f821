"""Local terms and lights against closed forms (model §7, §8)."""

import math
import os
import tempfile
import unittest

import numpy as np

from support import DOWN, FLOOR, Case, film
from whitstone_mitsuba import lights, mappings, sky, tabulated, textures
from whitstone_mitsuba.runtime import mi

HEAD = film() + DOWN
POINT = '[[light]]\ntype = "point"\nposition = [3, 4, 0]\nintensity = [25, 50, 75]\n'


def material(text):
    return FLOOR + f"material = {{ {text} }}\n"


class Lights(Case):
    def test_point_inverse_square(self):
        # d = 5, cos = 4/5: rho/pi * cos * I/d2
        self.near(self.value(HEAD + POINT + FLOOR), [0.5 / math.pi * 0.8 * number for number in (1, 2, 3)])

    def test_point_without_falloff(self):
        scene = HEAD + POINT + 'falloff = "none"\n' + FLOOR
        self.near(self.value(scene), [0.5 / math.pi * 0.8 * number for number in (25, 50, 75)])

    def test_directional(self):
        scene = HEAD + '[[light]]\ntype = "directional"\ndirection = [0, -2, 2]\nirradiance = 3\n' + FLOOR
        self.near(self.value(scene), 0.5 / math.pi * 3 * math.sqrt(0.5))

    def test_directional_from_below_is_hidden(self):
        scene = HEAD + '[[light]]\ntype = "directional"\ndirection = [0, 1, 0]\nirradiance = 3\n' + FLOOR
        self.assertEqual(list(self.value(scene)), [0, 0, 0])

    def spot(self, angle, more=""):
        """Lit from height 1 at the origin, axis tilted by `angle` degrees."""
        x = math.tan(math.radians(angle))
        light = f'[[light]]\ntype = "spot"\nposition = [0, 1, 0]\ntarget = [{x}, 0, 0]\nintensity = 1\n' + more
        return float(self.value(HEAD + light + FLOOR)[0]) * math.pi / 0.5

    def test_spot(self):
        self.near(self.spot(0), 1.0)
        self.near(self.spot(14.9), 1.0)
        self.near(self.spot(17.5), 0.5, rel=1e-5)
        self.assertEqual(self.spot(20.5), 0)
        wide = "cutoff_angle = 60\nbeam_width = 10\n"
        self.near(self.spot(30, wide), 0.6, rel=1e-5)

    def test_spot_image(self):
        """From height 2 above the origin, +x to the right in the image and -z up: on the floor, the
        image is 4 m wide.
        """
        cone = "cutoff_angle = 45\nbeam_width = 44.9\nup = [0, 0, -1]\n"
        light = '[[light]]\ntype = "spot"\nposition = [0, 2, 0]\ntarget = [0, 0, 0]\nintensity = 1\n'

        def spot(image, x, z, more="", cone=cone):
            look = HEAD.replace("origin = [0, 5, 0], target = [0, 0, 0]", f"origin = [{x}, 5, {z}], target = [{x}, 0, {z}]")
            return self.value(look + light + cone + f"image = {image}\n" + more + FLOOR)

        def expected(x, z, color, falloff=True):
            d2 = 4 + x * x + z * z
            return [0.5 / math.pi * 2 / math.sqrt(d2) / (d2 if falloff else 1) * part for part in color]

        # Ramps along a and along c.
        ramp = '{{ type = "gradient", a = 0, b = {}, wrap = "clamp", mapping = {{ transform = {{ matrix = {} }} }} }}'
        along_a, along_c = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]]
        for x, z in ((0, 0), (1, 0), (0, -1.5), (-0.9, 0.7)):
            a, c = (1 + x / 2) / 2, (1 - z / 2) / 2
            self.near(spot(ramp.format([1, 2, 3], along_a), x, z), expected(x, z, [a, 2 * a, 3 * a]), rel=1e-5)
            self.near(spot(ramp.format([1, 2, 3], along_c), x, z), expected(x, z, [c, 2 * c, 3 * c]), rel=1e-5)
            self.near(spot("[1, 2, 0.5]", x, z), expected(x, z, [1, 2, 0.5]), rel=1e-5)
            found = spot(ramp.format(1, along_a), x, z, 'falloff = "none"\n')
            self.near(found, expected(x, z, [a] * 3, falloff=False), rel=1e-5)
        # Outside of the cone, but inside of the square of the image.
        self.assertEqual(list(spot("1", 1.5, 1.5)), [0, 0, 0])
        # A texture of (u, v) whose two columns differ in width.
        quarters = '{ type = "checker", a = [1, 2, 3], b = 0, scale = [1.5, 2] }'
        for x, z, lit in ((1, -1, 1), (-1, 1, 1), (1, 0.5, 0), (-1, -1, 0)):
            self.near(spot(quarters, x, z), [lit * part for part in expected(x, z, [1, 2, 3])], rel=1e-5)
        # The soft edge is that of a spot light without an image.
        wide = "up = [1, 0, 0]\ncutoff_angle = 60\nbeam_width = 10\n"
        x = 2 * math.tan(math.radians(35))
        self.near(spot("0.5", x, 0, cone=wide), expected(x, 0, [0.5 * 0.5] * 3), rel=1e-5)
        self.refuse(HEAD + light + "image = 1\n" + FLOOR, "scene", "parallel")
        self.refuse(HEAD + light + "up = [1, 0, 0]\n" + FLOOR, "scene", "requires `image`")
        self.refuse(HEAD + light + "image = -1\nup = [1, 0, 0]\n" + FLOOR, "scene", ">= 0")

    def test_spot_image_is_that_of_mitsuba_turned(self):
        """Mitsuba's own spot light with a texture, at points of a plane."""
        pixels = np.random.default_rng(3).random((4, 4, 3), dtype=np.float32)
        axes = mi.ScalarTransform4f().look_at(origin=[1, 2, 3], target=[1, 0, 2], up=[0, 1, 0.3])
        bitmap = {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "filter_type": "nearest"}
        native = {"type": "spot", "to_world": axes, "cutoff_angle": 40.0, "beam_width": 20.0, "texture": bitmap}
        native = mi.load_dict({**native, "intensity": {"type": "rgb", "value": [1.0, 2.0, 3.0]}})
        up = -np.array(axes.matrix)[:3, 1]
        with tempfile.TemporaryDirectory() as base:
            mi.Bitmap(pixels).write(os.path.join(base, "image.exr"))
            light = '[[light]]\ntype = "spot"\nposition = [1, 2, 3]\ntarget = [1, 0, 2]\nintensity = [1, 2, 3]\ncutoff_angle = 40\nbeam_width = 20\n'
            light += f'up = {up.tolist()}\nimage = {{ type = "image", file = "image.exr", filter = "nearest" }}\n'
            for x, z in ((1, 2), (1.3, 1.4), (0.2, 2.1), (1.7, 2.6), (0.6, 1.3)):
                it = mi.SurfaceInteraction3f()
                it.p = mi.Point3f(x, 0, z)
                ds, value = native.sample_direction(it, mi.Point2f(0.5))
                expected = 0.5 / math.pi * np.array(value).reshape(3) * float(ds.d.y[0])
                self.assertGreater(min(expected), 0)
                look = HEAD.replace("origin = [0, 5, 0], target = [0, 0, 0]", f"origin = [{x}, 5, {z}], target = [{x}, 0, {z}]")
                self.near(self.value(look + light + FLOOR, base=base), expected, rel=1e-5)

    def test_background_is_visible_and_lights_nothing(self):
        scene = HEAD + '[[light]]\ntype = "background"\nradiance = [1, 2, 3]\n' * 2
        self.assertEqual(list(self.value(scene)), [2, 4, 6])
        self.assertEqual(list(self.value(scene + FLOOR)), [0, 0, 0])

    def test_area(self):
        """An area light at height 4 that faces down: the sum over its four sample points."""
        turn = "{ rotate = { axis = [1, 0, 0], degrees = 90 } }"
        light = '[[light]]\ntype = "area"\nshape = "{}"\nradiance = [1, 2, 3]\nsamples = 2\ntransform = [{}{}, {{ translate = [0, 4, 0] }}]\n'
        # Each point is half a metre off the centre along both axes; both cosines are 4/d.
        d2 = 16 + 0.5
        expected = 0.5 / math.pi * 4 * (4 / 4) * 16 / d2**2
        self.near(self.value(HEAD + light.format("rectangle", "", turn) + FLOOR), [expected * n for n in (1, 2, 3)])
        self.assertEqual(list(self.value(HEAD + light.format("rectangle", "", turn.replace("90", "-90")) + FLOOR)), [0, 0, 0])
        # A disk of twice the size, by its radii.
        expected = sum(0.5 / math.pi * 2 * (4 * math.pi / 4) * 16 / (16 + 4 * v) ** 2 for v in (0.25, 0.75))
        self.near(self.value(HEAD + light.format("disk", "{ scale = 2 }, ", turn) + FLOOR), [expected * n for n in (1, 2, 3)])
        # On a sphere about (0, 4, 0) only the two lower points count, at height 4 - 0.5.
        r2 = 0.75
        d2 = r2 + 3.5**2
        cosine = (0.5 * 3.5 - r2) / math.sqrt(d2)
        expected = 0.5 / math.pi * 2 * math.pi * cosine * 3.5 / d2**1.5
        self.near(self.value(HEAD + light.format("sphere", "", turn) + FLOOR), [expected * n for n in (1, 2, 3)])
        self.refuse(HEAD + light.format("sphere", "{ scale = [1, 2, 1] }, ", turn) + FLOOR, "scene", "similarity")
        # Without falloff only both cosines remain.
        none = 'falloff = "none"\n'
        expected = 0.5 / math.pi * 4 * 16 / 16.5
        self.near(self.value(HEAD + light.format("rectangle", "", turn) + none + FLOOR), [expected * n for n in (1, 2, 3)])
        expected = 0.5 / math.pi * 2 * math.pi * cosine * 3.5 / math.sqrt(d2)
        self.near(self.value(HEAD + light.format("sphere", "", turn) + none + FLOOR), [expected * n for n in (1, 2, 3)])
        self.refuse(HEAD + light.format("disk", "", turn) + 'falloff = "linear"\n' + FLOOR, "scene", "falloff")

    def test_area_of_a_mesh(self):
        """A square of two triangles that faces down at height 4, by the centroids of their parts.
        """
        text = "v -1 4 -1\nv 1 4 -1\nv 1 4 1\nv -1 4 1\nf 1 2 3 4\nf 1 1 2\n"
        light = '[[light]]\ntype = "area"\nshape = "mesh"\nfile = "{}"\nradiance = [1, 2, 3]\n{}\n'
        with tempfile.TemporaryDirectory() as base:

            def write(name, text):
                with open(os.path.join(base, name), "w") as file:
                    file.write(text)

            write("square.obj", text)
            scene = HEAD + light.format("square.obj", "") + FLOOR
            # The centroids are at (1/3, 4, -1/3) and (-1/3, 4, 1/3): both cosines are 4/d.
            d2 = 16 + (1 / 3) ** 2 + (1 / 3) ** 2
            expected = 0.5 / math.pi * 4 * 16 / d2**2
            self.near(self.value(scene, base=base), [expected * n for n in (1, 2, 3)])
            even = HEAD + light.format("square.obj", 'falloff = "none"') + FLOOR
            self.near(self.value(even, base=base), [expected * d2 * n for n in (1, 2, 3)])
            # Mirrored in its own plane, the front stays in front; turned over, it is dark.
            mirrored = light.format("square.obj", "transform = { scale = [-1, 1, 1] }")
            self.near(self.value(HEAD + mirrored + FLOOR, base=base), [expected * n for n in (1, 2, 3)])
            write("up.obj", text.replace("1 2 3 4", "4 3 2 1"))
            self.assertEqual(list(self.value(HEAD + light.format("up.obj", "") + FLOOR, base=base)), [0, 0, 0])
            # Nine parts per triangle: steps of a third of a side from (-1, -1) along (1, 0) and
            # (1, 1), and along (1, 1) and (0, 1).
            parts = [(s, t) for s in (1, 4, 7) for t in (1, 4, 7) if s + t <= 8] + [(2, 2), (5, 2), (2, 5)]
            places = [(-1 + 2 * (s + t) / 9, -1 + 2 * t / 9) for s, t in parts] + [(-1 + 2 * s / 9, -1 + 2 * (s + t) / 9) for s, t in parts]
            expected = 0.5 / math.pi * 4 / 18 * sum(16 / (16 + x * x + z * z) ** 2 for x, z in places)
            fine = light.format("square.obj", "samples = 3")
            self.near(self.value(HEAD + fine + FLOOR, base=base), [expected * n for n in (1, 2, 3)])
            write("line.obj", "v 0 0 0\nv 1 0 0\nf 1 2 2\n")
            self.refuse(HEAD + light.format("line.obj", "") + FLOOR, "scene", "every triangle is degenerate", base=base)
            self.refuse(HEAD + light.format("none.obj", "") + FLOOR, "scene", "cannot be read", base=base)
            write("many.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "f 1 2 3\n" * 1025)
            self.refuse(HEAD + light.format("many.obj", "samples = 2") + FLOOR, "scene", "4096", base=base)

    def projector(self, more, x=0.0, z=0.0, head=HEAD):
        """Onto the floor at (x, z) from 2 above the origin, +x to the right in the slide and -z up.
        """
        light = '[[light]]\ntype = "projector"\nposition = [0, 2, 0]\ntarget = [0, 0, 0]\nup = [0, 0, -1]\n' + more
        look = head.replace("origin = [0, 5, 0], target = [0, 0, 0]", f"origin = [{x}, 5, {z}], target = [{x}, 0, {z}]")
        return self.value(look + light + "\n" + FLOOR)

    def test_projector(self):
        # A screen at 2 m receives a quarter of the intensity everywhere; 90 degrees are 4 m wide.
        white = "fov = 90\nimage = 1\nintensity = [1, 2, 3]"
        for x, z in ((0, 0), (1.99, 0), (-1.9, 1.9)):
            self.near(self.projector(white, x, z), [0.5 / math.pi / 4 * n for n in (1, 2, 3)], rel=1e-5)
        for x, z in ((2.01, 0), (0, -2.01)):
            self.assertEqual(list(self.projector(white, x, z)), [0, 0, 0])
        # Twice as wide as high.
        wide = white + "\naspect = 2"
        self.near(self.projector(wide, 1.99, 0.99), [0.5 / math.pi / 4 * n for n in (1, 2, 3)], rel=1e-5)
        self.assertEqual(list(self.projector(wide, 0, 1.01)), [0, 0, 0])
        # The quadrants of the slide: the upper right one is at +x, -z.
        quarters = "fov = 90\nintensity = 1\nimage = { type = \"checker\", a = [1, 2, 3], b = 0, scale = 2 }"
        lit, dark = [0.5 / math.pi / 4 * n for n in (1, 2, 3)], [0, 0, 0]
        for x, z, expected in ((1, -1, lit), (-1, 1, lit), (1, 1, dark), (-1, -1, dark)):
            self.near(self.projector(quarters, x, z), expected, rel=1e-5)
        # Three columns, which show the orientation.
        columns = quarters.replace("scale = 2", "scale = [1.5, 1]")
        self.near(self.projector(columns, 1, 0.5), dark)
        self.near(self.projector(columns, -1, 0.5), lit, rel=1e-5)
        # A solid texture is looked up in the plane z = 0 of the slide.
        solid = "fov = 90\nintensity = 1\nimage = { type = \"checker\", a = [1, 2, 3], b = 0, scale = [1.5, 1], mapping = { projection = \"planar\" } }"
        self.near(self.projector(solid, 1, 0.5), dark)
        self.near(self.projector(solid, -1, 0.5), lit, rel=1e-5)
        light = '[[light]]\ntype = "projector"\nposition = [0, 2, 0]\ntarget = [0, 0, 0]\nimage = 1\nintensity = 1\n'
        self.refuse(HEAD + light + FLOOR, "scene", "parallel")
        self.refuse(HEAD + light + "aspect = 0\nup = [1, 0, 0]\n" + FLOOR, "scene", "0.001 to 1000")

    def test_environment(self):
        """Colours by direction: seen directly, in a mirror, and as illumination."""
        sky = '[[light]]\ntype = "environment"\nradiance = { type = "checker", a = [1, 2, 3], b = [4, 5, 6], scale = [4, 2] }\n'
        for target, expected in (([1, 0.5, -0.2], [4, 5, 6]), ([-1, -0.5, 0.2], [1, 2, 3])):
            look = f'[camera]\ntype = "perspective"\nlook_at = {{ origin = [0, 0, 0], target = {target} }}\n'
            # u = 0.5 + atan2(1, 0.2)/2pi is in cell 2, v above 1/2 in cell 1; u of the other in
            # cell 0, v in cell 0.
            self.assertEqual(list(self.value(film() + look + sky)), [float(number) for number in expected])
        mirror = 'look_at = { origin = [-1, 0.5, 0.2], target = [0, 0, 0] }'
        look = f'[camera]\ntype = "perspective"\n{mirror}\n'
        self.near(self.value(film() + look + sky + material('type = "mirror", reflectance = 0.5')), [2, 2.5, 3])
        # A uniform sky: pi times its radiance, times the reflectance / pi.
        even = '[[light]]\ntype = "environment"\nradiance = [1, 2, 3]\nsamples = 16\n'
        self.near(self.value(HEAD + even + FLOOR), [0.5 * number for number in (1, 2, 3)], rel=1e-2)
        # y > 0 is b at u in cells 1, 3 only: half of the upper sky.
        shining = sky + "samples = 16\n"
        self.near(self.value(HEAD + shining + FLOOR), [0.5 * (a + b) / 2 for a, b in ((1, 4), (2, 5), (3, 6))], rel=1e-2)
        black = '[[light]]\ntype = "environment"\nradiance = 0\nsamples = 4\n'
        self.assertEqual(list(self.value(HEAD + black + FLOOR)), [0.0, 0.0, 0.0])

    def test_sky_light(self):
        """The energy of a cell, divided between regions or not, and its centroid in closed form."""

        def hemisphere(uv, d):
            return np.where(d[:, 1:2] > 0, [[1.0, 2.0, 4.0]], [[0.0, 0.0, 0.0]])

        for n in (1, 3, 8):
            directions, irradiances = sky.directions(n, 1, hemisphere)
            np.testing.assert_allclose(irradiances.sum(axis=0), 2 * np.pi * np.array([1.0, 2.0, 4.0]), rtol=1e-12)
            np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
            self.assertTrue((directions[:, 1] > 0).all())
        # Two halves, each around (+-1, 1, 0) by symmetry: the integrals of x and y over a quarter
        # of the sphere are equal.
        directions, irradiances = sky.directions(1, 1, hemisphere)
        np.testing.assert_allclose(directions, [[-(0.5**0.5), 0.5**0.5, 0], [0.5**0.5, 0.5**0.5, 0]], atol=1e-12)
        # All light in one cell: every direction lies in it.
        one = np.zeros((512, 1024))
        one[300, 700] = 1.0
        directions, irradiances = sky.directions(4, 1, lambda uv, d: np.repeat(one.reshape(-1, 1), 3, axis=1))
        v, u = 0.5 + np.arcsin(directions[:, 1]) / np.pi, 0.5 + np.arctan2(directions[:, 0], -directions[:, 2]) / (2 * np.pi)
        np.testing.assert_allclose([u * 1024, v * 512], [np.full(len(u), 700.5), np.full(len(v), 300.5)], atol=0.5)
        np.testing.assert_allclose(irradiances.sum(axis=0), (np.sin(np.pi * (301 / 512 - 0.5)) - np.sin(np.pi * (300 / 512 - 0.5))) * 2 * np.pi / 1024, rtol=1e-12)

    def test_precise_lookups_agree_with_bitmaps(self):
        pixels = np.random.default_rng(1).random((6, 4, 3), dtype=np.float32)
        uv = np.random.default_rng(2).uniform(-0.2, 1.2, (200, 2))
        for kind in ("nearest", "bilinear"):
            for wrap in (("repeat", "repeat"), ("clamp", "clamp"), ("mirror", "mirror"), ("repeat", "clamp")):
                image = textures.Image(pixels, kind, wrap, (2.0, 1.0), (0.1, 0.3), mappings.Mapping("uv"))
                found = np.array(image.build().eval(lights.place(np.tile([[0.0, 1.0, 0.0]], (200, 1)), uv))).T
                np.testing.assert_allclose(image.precise(uv), found, atol=1e-5)

    def test_faces(self):
        """Six images of 2 x 2 texels, each texel with its own colour, viewed through texel centres.
        """
        forward = {"px": (1, 0, 0), "nx": (-1, 0, 0), "py": (0, 1, 0), "ny": (0, -1, 0), "pz": (0, 0, 1), "nz": (0, 0, -1)}
        upward = {"py": (0, 0, 1), "ny": (0, 0, -1)}
        sky = '[[light]]\ntype = "environment"\n'
        with tempfile.TemporaryDirectory() as base:

            def write(name, height, width, number):
                pixels = np.arange(height * width * 3, dtype=np.float32).reshape(height, width, 3) + 100 * number
                mi.Bitmap(pixels).write(os.path.join(base, name))

            for number, name in enumerate(forward):
                write(f"{name}.exr", 2, 2, number)
                sky += f'faces.{name}.file = "{name}.exr"\n'
            for number, (name, axis) in enumerate(forward.items()):
                up = np.array(upward.get(name, (0, 1, 0)))
                right = np.cross(axis, up)
                for column in (0, 1):
                    for row in (0, 1):
                        # A texel centre is halfway between the centre and the edge of the face.
                        target = (np.array(axis) + (column - 0.5) * right + (0.5 - row) * up).tolist()
                        helper = [0.3, 0.5, 0.7]
                        look = f'[camera]\ntype = "perspective"\nlook_at = {{ origin = [0, 0, 0], target = {target}, up = {helper} }}\n'
                        first = 100 * number + 6 * row + 3 * column
                        self.near(self.value(film() + look + sky, base=base), [first, first + 1, first + 2], rel=1e-4, atol=1e-4)
            look = '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 0, 0], target = [1, 2, 3] }\n'
            self.refuse(film() + look + sky.replace('faces.nz.file = "nz.exr"\n', ""), "scene", "faces.nz", "required", base=base)
            for name, height, width in (("wide", 2, 4), ("large", 4, 4)):
                write(f"{name}.exr", height, width, 0)
                self.refuse(film() + look + sky.replace("ny.exr", f"{name}.exr"), "scene", "square images of equal size", base=base)
            self.refuse(film() + look + sky + "radiance = 1\n", "scene", "either", base=base)

    def test_ambient(self):
        scene = HEAD + '[[light]]\ntype = "ambient"\nradiance = [1, 2, 3]\n' * 2
        self.near(self.value(scene + material('type = "matte", reflectance = [0.1, 0.2, 0.3]')), [0.2, 0.8, 1.8])
        self.near(self.value(scene + material('type = "phong", k_d = 0.25')), [0.5, 1.0, 1.5])
        self.near(self.value(scene + material('type = "phong", k_a = 1')), [2, 4, 6])
        self.assertEqual(list(self.value(scene + material('type = "mirror"'))), [0, 0, 0])

    def test_light_at_the_surface_gives_nothing(self):
        scene = HEAD + '[[light]]\ntype = "point"\nposition = [0, 0, 0]\nintensity = 1\n' + FLOOR
        self.assertEqual(list(self.value(scene)), [0, 0, 0])

    def test_shadows(self):
        blocker = '[[shape]]\ntype = "sphere"\ncenter = [1.5, 2, 0]\nradius = 0.1\nmaterial = { type = "dielectric" }\n'
        self.assertEqual(list(self.value(HEAD + POINT + FLOOR + blocker)), [0, 0, 0])
        beyond = blocker.replace("[1.5, 2, 0]", "[6, 8, 0]")
        self.near(self.value(HEAD + POINT + FLOOR + beyond), self.value(HEAD + POINT + FLOOR))
        off = HEAD + '[integrator]\ntype = "whitted"\nshadows = "none"\n' + POINT + FLOOR
        self.near(self.value(off + blocker), self.value(HEAD + POINT + FLOOR))

    def test_both_sides(self):
        under = FLOOR.replace("degrees = -90", "degrees = 90")
        self.near(self.value(HEAD + POINT + under), self.value(HEAD + POINT + FLOOR))


class Lobes(Case):
    # v = +y, l = (0.6, 0.8, 0): n.l = 0.8, r.v = 0.8, n.h = cos(acos(0.8) / 2)
    def test_phong(self):
        value = self.value(HEAD + POINT + material('type = "phong", k_d = 0.1, k_s = 0.2, exponent = 10'))
        expected = 0.1 * 0.8 + 0.2 * 0.8**10
        self.near(value, [expected, 2 * expected, 3 * expected])

    def test_blinn_phong(self):
        value = self.value(HEAD + POINT + material('type = "blinn_phong", k_d = 0.1, k_s = 0.2, exponent = 10'))
        expected = 0.1 * 0.8 + 0.2 * math.cos(math.acos(0.8) / 2) ** 10
        self.near(value, [expected, 2 * expected, 3 * expected])

    def test_whitted_lobes(self):
        value = self.value(HEAD + POINT + material('type = "whitted", k_d = 0.1, k_s = 0.2, exponent = 10'))
        self.near(value, self.value(HEAD + POINT + material('type = "phong", k_d = 0.1, k_s = 0.2, exponent = 10')))
        self.assertEqual(list(self.value(HEAD + POINT + material('type = "whitted"'))), [0, 0, 0])

    def test_phong_from_behind(self):
        under = FLOOR.replace("degrees = -90", "degrees = 90")
        text = 'material = { type = "phong", k_d = 0.1, k_s = 0.2, exponent = 10 }\n'
        self.near(self.value(HEAD + POINT + under + text), self.value(HEAD + POINT + FLOOR + text))

    # theta_h and theta_d are both half of acos(0.8).
    def test_tabulated(self):
        share = math.acos(0.8) / 2 / (math.pi / 2)
        for spacing, x in (("even", 3 * share), ("square_root", 3 * math.sqrt(share))):
            i, s = int(x), x - int(x)
            rows = [[0.2, [0.1, 0.15, 0.3]], [0.05, 0.1], [0.02, 0.01], [0, 0]]
            f = [
                (1 - s) * ((1 - share) * low[0] + share * (low[1][channel] if isinstance(low[1], list) else low[1]))
                + s * ((1 - share) * high[0] + share * high[1])
                for channel, (low, high) in enumerate([(rows[i], rows[i + 1])] * 3)
            ]
            text = f'type = "tabulated", values = {rows}, spacing = "{spacing}", tint = [1, 0.5, 0.25]'
            expected = [f[0] * 0.8, 0.5 * f[1] * 0.8 * 2, 0.25 * f[2] * 0.8 * 3]
            self.near(self.value(HEAD + POINT + material(text)), expected)
            under = FLOOR.replace("degrees = -90", "degrees = 90")
            self.near(self.value(HEAD + POINT + under + f"material = {{ {text} }}\n"), expected)

    def test_tabulated_ambient(self):
        ambient = '[[light]]\ntype = "ambient"\nradiance = [1, 2, 3]\n'
        constant = 'type = "tabulated", values = [[0.2, 0.2], [0.2, 0.2], [0.2, 0.2]], spacing = "{}", tint = 0.5'
        # 2 pi times the integral of 2/pi theta sin(4 theta) from 0 to pi/4, which is pi/16.
        ramp = 'type = "tabulated", values = [[0, 0.5], [0, 0.5]], spacing = "{}", tint = 0.8'
        for spacing in ("even", "square_root"):
            self.near(self.value(HEAD + ambient + material(constant.format(spacing))), [0.1 * math.pi * n for n in (1, 2, 3)])
            self.near(self.value(HEAD + ambient + material(ramp.format(spacing))), [0.4 * math.pi / 4 * n for n in (1, 2, 3)])

    def test_tabulated_albedo(self):
        for rows in (2, 5, 40):
            for square_root in (False, True):
                table = tabulated.Table(np.full((rows, 3, 3), 1 / math.pi), square_root)
                for degrees in range(0, 90, 10):
                    self.near(table.albedo(math.radians(degrees)), [1.0] * 3, rel=6e-4)

    def test_bad_tables(self):
        for values in ("[[0, 0]]", "[]", "[[0], [0]]", "[[0, 0], [0, 0, 0]]", "[[0, 0], [0, -1]]", "[[0, 0], [0, [1, 1]]]", "[[0, 0], 0]", "3"):
            self.refuse(HEAD + material(f'type = "tabulated", values = {values}'), "scene", "material.values", "rows of equal length")
        self.refuse(HEAD + material('type = "tabulated", values = [[0.32, 0.32], [0.32, 0.32]]'), "scene", "material.values", "albedo of 1.005")
        self.refuse(HEAD + material('type = "tabulated", values = [[0, 0], [0, 0]], spacing = "odd"'), "scene", "spacing")
        self.refuse(HEAD + material('type = "tabulated", values = [[0, 0], [0, 0]], tint = 2'), "scene", "tint")
        self.refuse(HEAD + material('type = "tabulated"'), "scene", "material.values", "required")

    def test_default_material(self):
        self.near(self.value(HEAD + POINT + FLOOR), self.value(HEAD + POINT + material('type = "matte", reflectance = 0.5')))


if __name__ == "__main__":
    unittest.main()
