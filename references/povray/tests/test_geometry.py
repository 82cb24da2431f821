"""Positions in images of cameras, shapes, textures and groups (model §4, §5, §9, §10)."""

import os
import struct
import tempfile
import unittest

from support import DOWN, Case, film, with_povray
from whitstone_povray import meshes
from whitstone_povray.settings import Setting
from whitstone_protocol.errors import SceneError

WHITE = '[[light]]\ntype = "ambient"\nradiance = 1\n'
SEEN = 'material = { type = "matte", reflectance = 1 }\n'
# Texture coordinates as colours: red where the cell of u is odd, and so on.
CELLS = 'material = { type = "matte", reflectance = { type = "checker", a = 1, b = 0.25, scale = %s } }\n'


@with_povray
class Cameras(Case):
    def spot(self, camera, x, y, width=8, height=4, **setting):
        """Whether each pixel sees a ball of radius 0.1 at a point of the plane z = 0."""
        ball = f'[[shape]]\ntype = "sphere"\ncenter = [{x}, {y}, 0]\nradius = 0.1\n' + SEEN
        pixels = [(i, j) for j in range(height) for i in range(width)]
        found = self.values(film(width, height) + camera + WHITE + ball, pixels, **setting)
        return [pixel for pixel, value in zip(pixels, found) if value[0] > 0.5]

    def test_pixel_centres_right_and_up(self):
        # Eight pixels to four metres: their centres are at -1.75, -1.25, ...
        ortho = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\nwidth = 4\n'
        self.assertEqual(self.spot(ortho, 1.25, 0.75), [(6, 0)])
        self.assertEqual(self.spot(ortho, 1.0, 0.5), [])
        persp = '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 0, 2], target = [0, 0, 0] }\nfov = 90\n'
        self.assertEqual(self.spot(persp, -1.75, -0.75), [(0, 3)])

    def test_windows(self):
        persp = '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 0, 2], target = [0, 0, 0] }\n'
        window = "window = { l = 0, r = 2, b = -1, t = 0, d = 2 }\n"
        self.assertEqual(self.spot(persp + window, 0.375, -0.125), [(1, 0)])
        ortho = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 2], target = [0, 0, 0] }\n'
        self.assertEqual(self.spot(ortho + "window = { l = 0, r = 4, b = 0, t = 4 }\n", 0.75, 3.5), [(1, 0)])

    def test_lenses(self):
        # The focal plane is halfway to the ball, so the ball appears shifted by as much as the lens
        # sample: here by a pixel, half a metre.
        look = 'look_at = { origin = [0, 0, 2], target = [0, 0, 0] }\nfov = 90\nfocus_distance = 1\n'
        lens = f'[camera]\ntype = "thin_lens"\n{look}aperture = {2**0.5}\nlens_samples = 2\n'
        ball = '[[shape]]\ntype = "sphere"\ncenter = [-0.25, 0.25, 0]\nradius = 0.1\n' + SEEN
        pixels = [(i, j) for j in range(4) for i in range(8)]
        found = self.values(film(8, 4) + lens + WHITE + ball, pixels)
        seen = {pixel: round(value[0], 2) for pixel, value in zip(pixels, found) if value[0] > 0.01}
        self.assertEqual(seen, {(2, 0): 0.25, (4, 0): 0.25, (2, 2): 0.25, (4, 2): 0.25})
        self.assertEqual(self.spot(lens.replace("= 2\n", "= 1\n"), -0.25, 0.25), [(3, 1)])

    def test_near_limits_of_perspective_are_refused(self):
        look = 'look_at = { origin = [0, 0, 2], target = [0, 0, 0] }\nnear = 0.5\n'
        self.refuse(film() + f'[camera]\ntype = "perspective"\n{look}', "unsupported", "camera.near")

    def test_near_limits_of_orthographic_move_the_origins(self):
        look = 'look_at = { origin = [0, 0, 2], target = [0, 0, 0] }\nwidth = 4\n'
        seen = {near: self.spot(f'[camera]\ntype = "orthographic"\n{look}near = {near}\n', 0.25, 0.25) for near in (0, 1.8, 2.2, -1)}
        self.assertEqual(seen, {0: [(4, 1)], 1.8: [(4, 1)], 2.2: [], -1: [(4, 1)]})
        # A ball behind the camera is seen if the rays start behind it.
        behind = 'look_at = { origin = [0, 0, -1], target = [0, 0, -2] }\nwidth = 4\n'
        for near, found in ((0, []), (-2, [(4, 1)])):
            self.assertEqual(self.spot(f'[camera]\ntype = "orthographic"\n{behind}near = {near}\n', 0.25, 0.25), found)

    def test_shifts_are_in_pixels_to_the_right_and_down(self):
        ortho = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\nwidth = 4\n'
        self.assertEqual(self.spot(ortho, 1.25, 0.75, dx=1.0), [(5, 0)])
        self.assertEqual(self.spot(ortho, 1.25, 0.25, dy=1.0), [(6, 0)])

    def test_thresholds_and_exposure_do_not_change_the_image(self):
        scene = film() + DOWN + WHITE + '[[shape]]\ntype = "sphere"\nmaterial = { type = "matte", reflectance = 0.3 }\n'
        nominal = self.values(scene)[0][0]
        for setting in ({"k": 64}, {"exposure": 1.3}):
            self.near(self.values(scene, **setting)[0], nominal, rel=2.0**-10)
        answer = self.ask("probe", scene, pixels=[[0, 0]], settings=[{"robust": True, "ulps": 0}])
        self.near(answer["values"][0][0], nominal)


@with_povray
class Shapes(Case):
    def seen(self, shape, points, more=""):
        """Checks the values at points of the plane, seen from above: the image is two metres wide
        and high.
        """
        camera = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 9], target = [0, 0, 0] }\nwidth = 2\n'
        size = 200
        pixels = [(int((x + 1) / 2 * size), int((1 - y) / 2 * size)) for x, y in points]
        found = self.values(film(size, size) + camera + WHITE + shape + more, pixels)
        return [round(value[0], 2) for value in found]

    def check(self, shape, points, expected, scale):
        self.assertEqual(self.seen(f"[[shape]]\n{shape}" + CELLS % scale, points), expected)

    def test_texture_coordinates(self):
        quarters = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)]
        self.check('type = "rectangle"\n', quarters, [1, 0.25, 1, 0.25], "[2, 2]")
        self.check('type = "rectangle"\n', quarters, [0.25, 1, 1, 0.25], "[2, 1]")
        self.check('type = "plane"\n', quarters, [1, 0.25, 1, 0.25], "[1, 1]")
        # phi in quarters, r in halves.
        self.check('type = "disk"\n', quarters, [0.25, 1, 0.25, 1], "[2, 4]")
        self.check('type = "disk"\n', [(0.2, 0.2), (-0.2, 0.2)], [1, 0.25], "[2, 4]")
        # The upper half: v from 1/2 up, u in quarters.
        self.check('type = "sphere"\n', quarters, [1, 0.25, 1, 0.25], "[4, 1]")
        # The face +z has u along x, v along y.
        self.check('type = "box"\n', quarters, [0.25, 1, 1, 0.25], "[2, 1]")
        self.check('type = "box"\n', quarters, [0.25, 0.25, 1, 1], "[1, 2]")
        triangle = 'type = "triangle"\nvertices = [[-1, -1, 0], [1, -1, 0], [-1, 1, 0]]\n'
        self.check(triangle, [(-0.75, -0.75), (0.5, -0.75), (0.5, 0.5)], [1, 0.25, 0], "[2, 1]")
        uvs = "uvs = [[0, 0], [0, 1], [1, 0]]\n"
        self.check(triangle + uvs, [(-0.75, -0.75), (0.5, -0.75), (-0.75, 0.5)], [1, 0.25, 1], "[1, 2]")

    def test_torus(self):
        # Red and black: phi in quarters; the outer half of the tube has |psi| below a quarter turn.
        torus = 'type = "torus"\nmajor_radius = 0.6\nminor_radius = 0.2\n'
        ring = [(0.45, 0.45), (-0.45, 0.45), (-0.45, -0.45), (0.45, -0.45)]
        self.check(torus, ring, [1, 0.25, 1, 0.25], "[4, 1]")
        self.check(torus, [(0.75, 0), (0.45, 0), (0, 0), (0, 0.39), (0, 0.41), (0, 0.79), (0, 0.81)], [1, 0.25, 0, 0, 0.25, 1, 0], "[1, 4]")
        turned = 'transform = { rotate = { axis = [1, 0, 0], degrees = 90 } }\n'
        self.check(torus + turned, [(0.7, 0.1), (0, 0.1), (0, 0.21)], [1, 1, 0], "[1, 1]")
        for keys in ("minor_radius = 1\n", "transform = { scale = [1, 2, 1] }\n"):
            self.refuse(film() + DOWN + '[[shape]]\ntype = "torus"\n' + keys, "scene", "minor_radius" if "minor" in keys else "similarity")

    def test_prism(self):
        # The letter U from above, where (u, v) = (z, x); z points down on the screen.
        letter = "outline = [[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [0.3, 0.9], [0.3, 0], [-0.3, 0], [-0.3, 0.9], [-0.9, 0.9]]\ny = [-0.2, 0.3]\n"
        turned = "transform = { rotate = { axis = [1, 0, 0], degrees = 90 } }\n"
        points = [(-0.6, -0.5), (0.6, -0.5), (0, -0.5), (0.05, 0.5), (-0.05, 0.5), (0.95, 0.5)]
        self.check('type = "prism"\n' + letter + turned, points, [0.25, 1, 0, 0.25, 1, 0], "[1, 1]")
        # The side z = 0.5 of a square: u from 1/2 to 3/4, towards -x; v up.
        square = 'type = "prism"\noutline = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]\ny = [-0.5, 0.5]\n'
        self.check(square, [(0.25, -0.25), (-0.25, -0.25), (0.25, 0.25), (0.55, 0)], [1, 0.25, 0.25, 0], "[8, 2]")
        for keys, word in (
            ("outline = [[0, 0], [1, 0]]\n", "3 to 4096"),
            ("outline = [[0, 0], [1, 0], [0, 1], [0, 0]]\n", "equal"),
            ("outline = [[0, 0], [1, 0], [2, 0]]\n", "area"),
            ("outline = [[0, 0], [1, 0], [0, 1]]\ny = [1, 0]\n", "ascending"),
        ):
            self.refuse(film() + DOWN + '[[shape]]\ntype = "prism"\n' + keys, "scene", word)

    def test_lathe(self):
        # A tube: phi from z to x, and v up.
        tube = 'type = "lathe"\noutline = [[0.5, -0.8], [0.5, 0.8]]\n'
        self.check(tube, [(0.25, 0.4), (-0.25, 0.4), (0.25, -0.4), (0.55, 0), (0, 0.85)], [0.25, 1, 1, 0, 0], "[4, 2]")
        # The upper disk of a drum, whose outline is 2.6 m long, and a disk with a hole.
        turned = "transform = { rotate = { axis = [1, 0, 0], degrees = 90 } }\n"
        drum = 'type = "lathe"\noutline = [[0, -0.5], [0.8, -0.5], [0.8, 0.5], [0, 0.5]]\n'
        self.check(drum + turned, [(0.5, 0), (0, 0.3), (0.1, 0), (0.85, 0)], [1, 0.25, 1, 0], "[1, 13]")
        ring = 'type = "lathe"\noutline = [[0.3, 0], [0.8, 0]]\n'
        self.check(ring + turned, [(0.2, 0), (0.35, 0), (0, 0.75), (0.85, 0)], [0, 1, 0.25, 0], "[1, 2]")
        for keys, word in (
            ("outline = [[1, 0]]\n", "2 to 4096"),
            ("outline = [[1, 0], [-1, 1]]\n", "at least 0"),
            ("outline = [[1, 0], [0, 0], [0, 1]]\n", "on the axis"),
            ("outline = [[0, 0], [1, 0], [0, 1e-12]]\n", "area"),
        ):
            self.refuse(film() + DOWN + '[[shape]]\ntype = "lathe"\n' + keys, "scene", word)

    def test_polygon(self):
        # An L-shaped polygon; u = x and v = y.
        corners = "vertices = [[-0.9, -0.9, 0], [0.9, -0.9, 0], [0.9, 0, 0], [0, 0, 0], [0, 0.9, 0], [-0.9, 0.9, 0]]\n"
        points = [(-0.5, 0.5), (0.5, 0.5), (-0.5, -0.5), (0.5, -0.5), (0.95, -0.5)]
        self.check('type = "polygon"\n' + corners, points, [0.25, 0, 1, 0.25, 0], "[1, 1]")
        # Seen along z, in a plane across which y is largest: u = z = -2y, v = x.
        slanted = "vertices = [[-0.5, 0, 0], [-0.5, -0.5, 1], [0.5, -0.5, 1], [0.5, 0, 0]]\n"
        self.check('type = "polygon"\n' + slanted, [(0.25, -0.1), (-0.25, -0.1), (0.25, -0.4), (0.25, 0.1)], [1, 0.25, 0.25, 0], "[2, 1]")
        for vertices, word in (
            ("[[0, 0, 0], [1, 0, 0]]", "3 to 4096"),
            ("[[0, 0, 0], [1, 0, 0], [2, 0, 0]]", "no area"),
            ("[[0, 0, 0], [1, 0, 0], [1, 1, 1e-6], [0, 1, 0]]", "plane"),
        ):
            self.refuse(film() + DOWN + f'[[shape]]\ntype = "polygon"\nvertices = {vertices}\n', "scene", word)

    def test_transforms_and_groups(self):
        group = '[[group.g.shape]]\ntype = "box"\ntransform = [{ scale = 0.1 }, { translate = [0.5, 0, 0] }]\n' + SEEN
        places = ['{ rotate = { axis = [0, 0, 1], degrees = 90 } }', '[{ scale = [-1, 2, 1] }, { translate = [0, -0.5, 0] }]']
        copies = "".join(f'[[shape]]\ntype = "instance"\ngroup = "g"\ntransform = {place}\n' for place in places)
        points = [(0, 0.5), (0.5, 0), (-0.5, -0.5), (-0.5, -0.65), (-0.5, -0.75), (0, 0)]
        self.assertEqual(self.seen(group + copies, points), [1, 0, 1, 1, 0, 0])

    def test_meshes(self):
        quad = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 -1/-1\n"
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "quad.obj")
            with open(path, "w", encoding="utf-8") as file:
                file.write(quad)
            shape = f'[[shape]]\ntype = "mesh"\nfile = "{path}"\ntransform = {{ scale = 0.5 }}\n' + CELLS % "[2, 1]"
            points = [(0.25, 0.25), (-0.25, 0.25), (0.25, -0.25), (0.75, 0)]
            self.assertEqual(self.seen(shape, points), [0.25, 1, 0.25, 0])
            self.assertEqual(self.seen(shape.replace("transform", "uv_sets = []\ntransform"), points), [1, 1, 1, 0])

    def test_stl(self):
        facets = (((-1, -1, 0), (1, -1, 0), (1, 1, 0)), ((-1, -1, 0), (1, 1, 0), (-1, 1, 0)))
        binary = bytes(80) + struct.pack("<I", 2)
        text = "solid facet\n"
        for facet in facets:
            binary += struct.pack("<12fH", 0, 0, 0, *(number for point in facet for number in point), 0)
            text += "facet normal 0 0 0\nouter loop\n"
            text += "".join("vertex {} {} {}\n".format(*point) for point in facet) + "endloop\nendfacet\n"
        with tempfile.TemporaryDirectory() as folder:
            for name, data in (("b.stl", binary), ("t.stl", text.encode())):
                path = os.path.join(folder, name)
                with open(path, "wb") as file:
                    file.write(data)
                shape = f'[[shape]]\ntype = "mesh"\nfile = "{path}"\ntransform = {{ scale = 0.5 }}\n' + CELLS % "[2, 1]"
                self.assertEqual(self.seen(shape, [(0.25, 0.25), (-0.25, 0.1), (0.75, 0)]), [1, 1, 0])

    def test_texture_coordinates_of_round_shapes(self):
        quarters = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)]
        for shape in (
            'type = "ellipsoid"\nradii = [1, 2, 0.1]\n',
            'type = "cone"\n',
            'type = "paraboloid"\ncaps = false\n',
            'type = "hyperboloid"\nz = [-1, -0.1]\ncaps = false\n',
        ):
            self.check(shape, quarters, [1, 0.25, 1, 0.25], "[4, 1]")
        # Caps have r and phi, the upper one of radius 1.
        for shape in ('type = "cylinder"\n', 'type = "paraboloid"\n', 'type = "hyperboloid"\nradius = 0.6\nslope = 0.8\n'):
            self.check(shape, quarters, [0.25, 1, 0.25, 1], "[2, 4]")
            self.check(shape, [(0.2, 0.2), (-0.2, 0.2)], [1, 0.25], "[2, 4]")
        # The height: half of the cone's is at half of its radius.
        self.check('type = "cone"\n', [(0.2, 0.2), (0.6, 0.2)], [0.25, 1], "[1, 2]")
        self.check('type = "ellipsoid"\nradii = [1, 1, 0.01]\n', [(0.2, 0.2), (0.9, 0.2)], [1, 0.25], "[1, 3]")
        # In the box of the quadric.
        sphere = 'type = "quadric"\ncoefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -0.81]\nbox = [[-1, -1, -1], [1, 1, 0.1]]\n'
        self.check(sphere, quarters + [(0.8, 0.8)], [1, 0.25, 1, 0.25, 0], "[2, 2]")

    def test_positions_of_quadrics(self):
        # x^2 - y^2 >= 0.25, seen along z.
        points = [(0.7, 0.1), (0.4, 0.1), (-0.7, 0.1), (0.7, 0.6), (0.1, 0.7)]
        walls = '[[shape]]\ntype = "quadric"\ncoefficients = [-1, 1, 0, 0, 0, 0, 0, 0, 0, 0.25]\n'
        self.assertEqual(self.seen(walls + SEEN, points), [1, 0, 1, 0, 0])
        self.assertEqual(self.seen(walls + "caps = false\n" + SEEN, points), [0, 0, 0, 0, 0])
        matrix = '[[shape]]\ntype = "quadric"\nmatrix = [[1, 0, 0, -0.3], [0, 1, 0, 0], [0, 0, 1, 0], [-0.3, 0, 0, 0]]\n'
        self.assertEqual(self.seen(matrix + SEEN, [(0.59, 0.0), (0.61, 0.0), (0.0, 0.1)]), [1, 0, 0])
        mixed = '[[shape]]\ntype = "quadric"\ncoefficients = [0, 0, 0, 1, 0, 0, 0, 0, 0, -0.25]\n'
        self.assertEqual(self.seen(mixed + SEEN, [(0.45, 0.45), (0.55, 0.55), (-0.55, -0.55), (-0.45, 0.9)]), [1, 0, 0, 1])
        tube = '[[shape]]\ntype = "cylinder"\nradius = 0.5\ntransform = { rotate = { axis = [1, 0, 0], degrees = %s } }\n'
        self.assertEqual(self.seen(tube % 90 + SEEN, [(0.45, 0.9), (0.55, 0.9), (0.0, -0.98)]), [1, 0, 1])
        self.assertEqual(self.seen(tube % 0 + "caps = false\n" + SEEN, [(0.45, 0.0)]), [0])

    def test_the_rim_of_a_hyperboloid_is_inside_its_bounds(self):
        # From the side. POV-Ray's own box ends at 0.72 here unless the constant is -1.
        turn = "transform = { rotate = { axis = [1, 0, 0], degrees = 90 } }\n"
        tower = '[[shape]]\ntype = "hyperboloid"\nradius = 0.2\nslope = 0.8\nz = [-0.9, 0.3]\ncaps = false\n' + turn + SEEN
        self.assertEqual(self.seen(tower, [(0.735, 0.895), (-0.735, 0.895), (0.75, 0.895), (0.19, 0.0)]), [1, 1, 0, 1])

    def test_csg(self):
        ball = '{ type = "sphere", radius = %s, transform = { translate = [%s, 0, 0] } }'
        joined = '[[shape]]\ntype = "csg"\noperation = "%s"\noperands = [%s, %s]\n' + SEEN
        points = [(-0.7, 0.0), (0.0, 0.0), (0.7, 0.0), (0.0, 0.5)]
        found = [self.seen(joined % (name, ball % (0.6, -0.3), ball % (0.6, 0.3)), points) for name in ("union", "intersection")]
        self.assertEqual(found, [[1, 1, 1, 1], [0, 1, 0, 1]])
        plane = '{ type = "plane", transform = [{ rotate = { axis = [0, 1, 0], degrees = 70 } }, { translate = [0.1, 0, 0] }] }'
        bored = [joined % ("difference", ball % (0.9, 0), cut) for cut in (ball % (0.6, 0.3), plane)]
        # The hole is lit like the outside. The difference with the plane keeps its positive side.
        self.assertEqual(self.seen(bored[0], [(-0.5, 0.0), (0.3, 0.0), (0.85, 0.4)]), [1, 1, 0])
        self.assertEqual(self.seen(bored[1], [(-0.5, 0.0), (-0.25, 0.0), (-0.2, 0.0), (0.3, 0.0)]), [0, 0, 1, 1])
        pipe = '{ type = "cylinder", radius = 0.3 }'
        self.assertEqual(self.seen(joined % ("difference", ball % (0.9, 0), pipe), [(0.25, 0.0), (0.35, 0.0)]), [0, 1])
        inner = '{ type = "csg", operation = "difference", operands = [%s, %s], transform = { translate = [0.2, 0, 0] } }'
        nested = joined % ("intersection", ball % (0.9, 0), inner % (ball % (0.9, 0), pipe))
        self.assertEqual(self.seen(nested, [(0.2, 0.0), (0.6, 0.0), (-0.8, 0.0), (-0.6, 0.0)]), [0, 1, 0, 1])

    def test_meshes_and_level_sets_in_csg(self):
        joined = '[[shape]]\ntype = "csg"\noperation = "difference"\noperands = [%s, %s]\ntransform = { translate = [0.2, 0, 0] }\n' + SEEN
        # Where the plane cuts the tetrahedron, x + y <= 0 in the space of the csg, which is moved.
        corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "corner.obj")
            with open(path, "w", encoding="utf-8") as file:
                file.write(corners)
            mesh = '{ type = "mesh", file = "%s", transform = [{ scale = 2 }, { translate = [-0.5, -0.5, -1.5] }] }' % path
            cut = '{ type = "plane", transform = { translate = [0, 0, -0.5] } }'
            points = [(0.15, 0.0), (-0.25, 0.4), (0.25, 0.0), (-0.25, 0.5), (-0.35, 0.0)]
            self.assertEqual(self.seen(joined % (mesh, cut), points), [1, 1, 0, 0, 0])
        ball = '{ type = "implicit", field = { sphere = { radius = 0.6 } } }'
        pipe = '{ type = "implicit", field = { union = [{ box = { half = [0.2, 0.2, 3] } }] } }'
        self.assertEqual(self.seen(joined % (ball, pipe), [(0.2, 0.0), (0.45, 0.0), (0.85, 0.0)]), [0, 1, 0])
        grid = '{ type = "isosurface", size = [3, 3, 3], values = [%s] }' % ", ".join("1" if i == 13 else "0" for i in range(27))
        self.assertEqual(self.seen(joined % (grid, pipe), [(0.2, 0.0), (0.5, 0.0), (0.75, 0.0)]), [0, 1, 0])

    def test_invalid_operands_are_refused(self):
        joined = film() + DOWN + '[[shape]]\ntype = "csg"\noperation = "union"\noperands = [%s, { type = "sphere" }]\n'
        for operand in ('{ type = "disk" }', '{ type = "cylinder", caps = false }', '{ type = "sphere", material = "m" }'):
            self.refuse(joined % operand, "scene", "operands[0]")
        textured = joined % '{ type = "box" }' + CELLS % 2
        self.refuse(textured, "unsupported", "texture coordinates on a csg")


class Meshes(unittest.TestCase):
    def tetrahedron(self, *flipped):
        faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
        faces = [face[::-1] if number in flipped else face for number, face in enumerate(faces)]
        none = [None] * len(faces)
        return meshes.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [], [], faces, none, none)

    def test_open_and_inverted_meshes_are_not_closed(self):
        self.assertTrue(meshes.closed(self.tetrahedron()))
        self.assertFalse(meshes.closed(self.tetrahedron(2)))
        self.assertFalse(meshes.closed(self.tetrahedron(0, 1, 2, 3)))
        whole = self.tetrahedron()
        part = meshes.Mesh(whole.positions, [], [], whole.faces[:3], whole.normal_faces[:3], whole.uv_faces[:3])
        self.assertFalse(meshes.closed(part))

    def test_faces_before_their_vertices_and_lines_of_stl(self):
        corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        loop = "".join("  vertex %g %g %g\n" % corner for corner in corners)
        stl = f"solid a\nfacet normal 0 0 1\nouter loop\n{loop}endloop\nendfacet\nendsolid\n"
        obj = "f 1 2 3\n" + "".join("v %g %g %g\n" % corner for corner in corners)
        files = [("a.obj", obj), ("b.obj", "\ufeff" + obj)]
        files += [("c.stl", stl.replace("\n", end)) for end in ("\n", "\r", " ")]
        with tempfile.TemporaryDirectory() as folder:
            for name, text in files:
                path = os.path.join(folder, name)
                with open(path, "w", encoding="utf-8", newline="") as file:
                    file.write(text)
                found = meshes.load(path)
                self.assertEqual([found.positions[k] for k in found.faces[0]], corners, name)
            with open(os.path.join(folder, "d.obj"), "w", encoding="utf-8") as file:
                file.write(obj.replace("f 1 2 3", "f 1 2 4"))
            with self.assertRaisesRegex(SceneError, "does not exist"):
                meshes.load(os.path.join(folder, "d.obj"))

    def test_an_obj_face_without_vertices_is_an_error_of_the_scene(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "none.obj")
            with open(path, "w", encoding="utf-8") as file:
                file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf //1 //1 //1\n")
            with self.assertRaisesRegex(SceneError, "has no vertex"):
                meshes.load(path)

    def test_vertices_are_rounded_to_a_neighbour_and_equal_ones_equally(self):
        values = [k / 10 for k in range(-50, 50)]
        changed = 0
        for seed in range(4):
            rounded = meshes.rounding(Setting(vertices=True, seed=seed))
            for value in values:
                found = rounded(value)
                self.assertEqual(found, rounded(value))
                self.assertLessEqual(abs(found - value), 2.0**-23 * abs(value))
                changed += found != meshes.rounding(Setting(vertices=True, seed=seed + 1))(value)
        self.assertGreater(changed, 50)


@with_povray
class Faults(Case):
    """A reference is useful only if small changes affect its images."""

    def test_a_small_change_affects_the_image(self):
        light = '[[light]]\ntype = "point"\nposition = [3, 4, 0]\nintensity = 25\n'
        ball = '[[shape]]\ntype = "sphere"\nradius = 1\ncenter = [%s, 0, 0]\nmaterial = { type = "matte", reflectance = %s }\n'
        scene = film() + DOWN + light
        nominal = self.values(scene + ball % (0, 0.5))[0][0]
        self.assertGreater(abs(self.values(scene + ball % (0, 0.501))[0][0] / nominal - 1), 1e-3)
        self.assertGreater(abs(self.values(scene + ball % (0.01, 0.5))[0][0] / nominal - 1), 1e-3)


if __name__ == "__main__":
    unittest.main()
