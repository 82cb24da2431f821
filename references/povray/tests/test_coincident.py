"""Coincident surfaces of different shapes (model §9): pairs, order, gaps, and what POV-Ray shows."""

import os
import tempfile
import unittest

from support import BLACK_LIMIT, DOWN, FLOOR, Case, film, with_povray
from whitstone_povray import coincident, tracing
from whitstone_povray.settings import Setting
from whitstone_povray.transforms import IDENTITY, point

WHITE = '[[light]]\ntype = "ambient"\nradiance = 1\n'
HEAD = film(24, 18) + DOWN + BLACK_LIMIT + WHITE
GLASS = 'material = { type = "dielectric", absorption = [0.4, 0.1, 0.2] }\n'
ON = "{ rotate = { axis = [1, 0, 0], degrees = -90 } }"
GAP = coincident.GAP / Setting().scale
CUBE = """v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 4 1 5 8\n"""


def matte(grey):
    return f'material = {{ type = "matte", reflectance = {grey} }}\n'


def shape(kind, steps, material="", keys="", table="shape"):
    return f'[[{table}]]\ntype = "{kind}"\n{keys}transform = [{steps}]\n' + material


def box(x, y, z, half, material="", table="shape"):
    return shape("box", f"{{ scale = {half} }}, {{ translate = [{x}, {y}, {z}] }}", material, table=table)


class Separated(Case):
    def told(self, shapes, base="."):
        document = tracing.documents(tracing.Scene(HEAD + shapes, base), Setting())[0]
        return document.coincident

    def pairs(self, shapes, base="."):
        found = self.told(shapes, base)
        for entry in found:
            # Meshes make it wider.
            self.assertGreater(entry["gap"], 0.99 * GAP)
            self.assertLess(entry["gap"], 2 * GAP)
        return [(*entry["shapes"], entry["form"]) for entry in found]

    def unmoved(self, shapes):
        self.assertEqual(self.told(shapes), [])

    def test_flat_faces_of_all_kinds(self):
        stands = f'{{ translate = [0, 0, 1] }}, {ON}'
        for kind, keys, steps in (
            ("box", "", stands),
            ("rectangle", "", ON),
            ("disk", "", ON),
            ("cylinder", "", stands),
            ("cone", "radii = [1, 0.5]\n", ON),
            ("paraboloid", "", stands.replace("1]", "-1]")),
            ("hyperboloid", "", stands),
            ("triangle", "vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\n", ON),
            ("polygon", "vertices = [[0, 0, 0], [3, 0, 0], [3, 3, 0], [1, 1, 0]]\n", ON),
        ):
            with self.subTest(kind=kind):
                self.assertEqual(self.pairs(FLOOR + shape(kind, steps, keys=keys)), [(0, 1, "plane")])

    def test_planes_spheres_and_cylinders(self):
        ball = '[[shape]]\ntype = "sphere"\ncenter = [0, 1, 2]\nradius = %s\n'
        self.assertEqual(self.pairs(ball % 0.5 + ball % 0.5), [(0, 1, "sphere")])
        self.unmoved(ball % 0.5 + ball % 0.500001)
        pipe = '[[shape]]\ntype = "cylinder"\ncaps = false\nz = [%s, %s]\n'
        self.assertEqual(self.pairs(pipe % (0, 2) + pipe % (1, 3)), [(0, 1, "cylinder")])
        self.unmoved(pipe % (0, 2) + pipe % (2, 3))
        self.assertEqual(self.pairs(FLOOR + FLOOR), [(0, 1, "plane")])
        self.unmoved(FLOOR + shape("plane", ON + ", { translate = [0, 1e-9, 0] }"))

    def test_only_overlaps_with_an_area_and_within_16_ulp(self):
        self.unmoved(box(0, 0, 0, 1) + box(2, 2, 0, 1))
        self.unmoved(box(0, 0, 0, 1) + box(2.000001, 0, 0, 1))
        self.assertEqual(self.pairs(box(0, 0, 0, 1) + box(2, 1.9, 0, 1)), [(0, 1, "plane")])
        for ulps, found in ((4, 1), (40, 0)):
            distance = 2 + ulps * 3 * 2.0**-52
            self.assertEqual(len(self.told(box(0, 0, 0, 1) + box(distance, 0, 0, 1))), found)
        # A polygon that is not convex, and a box in its notch.
        notched = "vertices = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [2, 1, 0], [0, 4, 0]]\n"
        self.unmoved(shape("polygon", "", keys=notched) + box(2, 3, 0.5, 0.5))
        self.assertEqual(self.pairs(shape("polygon", "", keys=notched) + box(2, 0.9, 0.5, 0.5)), [(0, 1, "plane")])

    def test_instances_and_csg(self):
        group = "[group.g]\n" + box(0, 1, 0, 1, table="group.g.shape") + box(0, 2.5, 0, 0.5, table="group.g.shape")
        placed = '[[shape]]\ntype = "instance"\ngroup = "g"\n'
        self.assertEqual(self.pairs(group + FLOOR + placed), [(0, 1, "plane"), (1, 1, "plane")])
        cut = '{ type = "box", transform = { translate = [0, 1, 0] } }, { type = "sphere", center = [0, 2, 0] }'
        csg = f'[[shape]]\ntype = "csg"\noperation = "difference"\noperands = [{cut}]\n'
        self.assertEqual(self.pairs(FLOOR + csg), [(0, 1, "plane")])

    def test_meshes_and_what_cannot_be_separated(self):
        with tempfile.TemporaryDirectory() as base:
            with open(os.path.join(base, "cube.obj"), "w", encoding="utf-8") as file:
                file.write(CUBE)
            cube = '[[shape]]\ntype = "mesh"\nfile = "cube.obj"\ntransform = { translate = [%s, 1, %s] }\n'
            self.assertEqual(self.pairs(FLOOR + cube % (0, 0) + cube % (5, 0), base), [(0, 1, "plane"), (0, 2, "plane")])
            self.assertEqual(self.pairs(cube % (0, 0) + cube % (2, 0), base), [(0, 1, "plane")])
            # The cube in the corner would have to move along x and along z, which it does not.
            found = self.told(cube % (0, 0) + cube % (2, 0) + cube % (2, 2), base)
            self.assertEqual([entry["gap"] is None for entry in found], [True, False], found)
        thin = shape("box", "{ scale = [1, 1e-6, 1] }, { translate = [0, 1e-6, 0] }")
        self.assertEqual([entry["gap"] for entry in self.told(thin + box(0, -1, 0, 1))], [GAP])
        self.assertEqual([entry["gap"] for entry in self.told(thin + FLOOR)], [GAP])
        self.assertEqual([entry["gap"] for entry in self.told(thin + thin)], [None])

    def test_too_many_faces_are_not_examined(self):
        limit, coincident.MAX_FACES = coincident.MAX_FACES, 1
        try:
            self.assertIn("faces lie near", self.told(FLOOR + box(0, 1, 0, 1) + box(9, 1, 0, 1))[-1]["not_examined"])
        finally:
            coincident.MAX_FACES = limit

    def test_scenes_without_them_are_written_as_before(self):
        apart = self.ask("write", HEAD + FLOOR + box(0, 1.5, 0, 1))["scenes"][0]
        self.assertIn("matrix <1.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0,0.0,1536.0,0.0>", apart)
        stands = self.ask("write", HEAD + FLOOR + box(0, 1, 0, 1))["scenes"][0]
        self.assertNotIn("0.0,1024.0,0.0>", stands)


class Order(unittest.TestCase):
    def heights(self, *outlines):
        """The height of the face at the origin of each shape after the separation, in gaps."""
        shapes = [coincident.Placed(outline, matrix, ("", k, 0), k) for k, (outline, matrix) in enumerate(outlines)]
        moves, told = coincident.separate(shapes, Setting().scale)
        self.assertTrue(all(entry["gap"] for entry in told), told)
        found = []
        for k, placed in enumerate(shapes):
            inner, outer = moves.get(k, coincident.STAYS)
            z = 0.0
            if placed.outline.closed:
                z = -placed.matrix[2][3]
            found.append(round(point(outer, point(placed.matrix, point(inner, (0.0, 0.0, z))))[2] / GAP))
        return found

    up = coincident.sheet([(0, 0, 0), (1, 0, 0), (0, 1, 0)], (0, 0, 1))
    down = coincident.sheet([(0, 0, 0), (1, 0, 0), (0, 1, 0)], (0, 0, -1))
    above = (coincident.box(), (*IDENTITY[:2], (0.0, 0.0, 1.0, 1.0)))
    below = (coincident.box(), (*IDENTITY[:2], (0.0, 0.0, 1.0, -1.0)))

    def test_open_surfaces(self):
        up, down = (self.up, IDENTITY), (self.down, IDENTITY)
        # The first in the file is the first that is seen from the side of its normal.
        self.assertEqual(self.heights(up, up, up), [0, -1, -2])
        self.assertEqual(self.heights(down, down), [0, 1])
        self.assertEqual(self.heights(up, down), [0, -1])
        self.assertEqual(self.heights(up, down, up), [0, -2, -1])

    def test_solids_are_on_the_side_of_their_inside(self):
        up = (self.up, IDENTITY)
        self.assertEqual(self.heights(self.above, up), [1, 0])
        self.assertEqual(self.heights(up, self.above), [0, 1])
        self.assertEqual(self.heights(self.below, up, self.above), [-1, 0, 1])
        self.assertEqual(self.heights(self.above, self.above, up), [1, 2, 0])
        self.assertEqual(self.heights(self.below, self.below), [0, -1])
        self.assertEqual(self.heights(self.above, self.below), [0, -1])


@with_povray
class Shown(Case):
    def image(self, scene):
        pixels = [(x, y) for y in range(18) for x in range(24)]
        # From the side, so that distances to a common face are rounded.
        view = DOWN.replace("origin = [0, 5, 0]", "origin = [1.6, 3.9, 3.4]").replace("[0, 0, -1]", "[0, 1, 0]")
        return self.values(HEAD.replace(DOWN, view) + scene, pixels)

    def agree(self, touching, apart):
        """All pixels agree with those of a scene with gaps written by hand."""
        found, expected = self.image(touching), self.image(apart)
        self.assertGreater(len(set(map(tuple, expected))), 1)
        for one, other in zip(found, expected):
            self.near(one, other, rel=1e-3)

    def test_glass_on_a_plane(self):
        floor = FLOOR + matte(0.5)
        self.agree(floor + box(0.1, 1, 0.1, 1, GLASS), floor + box(0.1, 1.00001, 0.1, 1, GLASS))

    def test_glass_on_glass(self):
        floor = FLOOR + matte(0.5)
        self.agree(
            floor + box(0, 1, 0, 1, GLASS) + box(0.1, 2.5, 0.1, 0.5, GLASS),
            floor + box(0, 1.00001, 0, 1, GLASS) + box(0.1, 2.50002, 0.1, 0.5, GLASS),
        )

    def test_matte_boxes_with_a_common_face(self):
        # They overlap: of the common top the first box is seen.
        for first, second in ((0.2, 0.8), (0.8, 0.2)):
            one = FLOOR + matte(0.5) + box(-0.3, 0.7, 0, 0.7, matte(first))
            turned = "{ scale = 0.7 }, { rotate = { axis = [0, 1, 0], degrees = 20 } }, { translate = [0.3, %s, 0.2] }"
            other = shape("box", turned, matte(second))
            self.agree(one + other % 0.7, one + other % 0.69999)
        # They touch: the second one lies on the first.
        self.agree(
            box(0, 0, 0, 1, matte(0.2)) + box(0.3, 1.5, 0.2, 0.5, matte(0.8)),
            box(0, 0, 0, 1, matte(0.2)) + box(0.3, 1.50001, 0.2, 0.5, matte(0.8)),
        )

    def test_spheres_and_carpets(self):
        ball = '[[shape]]\ntype = "sphere"\nradius = %s\n'
        self.agree(ball % 1 + matte(0.2) + ball % 1 + matte(0.8), ball % 1 + matte(0.2) + ball % 0.99999 + matte(0.8))
        carpet = shape("rectangle", ON + ", { translate = [%s, %s, 0] }")
        self.agree(
            carpet % (0, 0) + matte(0.2) + carpet % (0.5, 0) + matte(0.8) + FLOOR + matte(0.5),
            carpet % (0, 0.00002) + matte(0.2) + carpet % (0.5, 0.00001) + matte(0.8) + FLOOR + matte(0.5),
        )


if __name__ == "__main__":
    unittest.main()
