"""Coincident surfaces: the image equals that with explicit gaps; other scenes do not change."""

import unittest
from unittest import mock

import numpy as np
from support import Case, film

from whitstone_mitsuba import coincident

HEAD = (
    film(40, 30)
    + """
[camera]
type = "perspective"
look_at = { origin = [2.3, 2.1, 4.2], target = [0, 0.4, 0] }
fov = 40
[integrator]
type = "whitted"
max_depth = 8
[[light]]
type = "point"
position = [2, 5, 3]
intensity = 60
[[light]]
type = "background"
radiance = [0.3, 0.5, 0.7]
"""
)
UP = "{ rotate = { axis = [1, 0, 0], degrees = -90 } }"
GLASS = 'material = { type = "dielectric", interior_ior = 1.5, absorption = [0.4, 0.2, 0.1] }\n'
RED = 'material = { type = "matte", reflectance = [0.8, 0.2, 0.1] }\n'
BLUE = 'material = { type = "matte", reflectance = [0.1, 0.2, 0.8] }\n'
GAP = 1e-5


def shape(kind, steps, material):
    return f'[[shape]]\ntype = "{kind}"\ntransform = [{steps}]\n{material}'


def cuboid(half, center, material):
    return shape("box", f"{{ scale = {half} }}, {{ translate = {center} }}", material)


def on_a_plane(gap):
    return shape("plane", UP, BLUE) + cuboid([0.7, 0.5, 0.6], [0.1, 0.5 + gap, 0.05], GLASS)


def stacked(gap):
    """Two boxes on a disk, with a rectangle on top."""
    return (
        shape("disk", f"{{ scale = 3 }}, {UP}", BLUE)
        + cuboid([0.6, 0.2, 0.6], [0, 0.2 + gap, 0], GLASS)
        + cuboid([0.6, 0.2, 0.6], [0, 0.6 + 2 * gap, 0], GLASS)
        + shape("rectangle", f"{UP}, {{ translate = [0, {0.8 + 3 * gap}, 0] }}", RED)
    )


def carpets(gap):
    """Of two open surfaces, the first in the file is in front."""
    return shape("rectangle", f"{UP}, {{ translate = [0, {gap}, 0] }}", RED) + shape("rectangle", f"{{ scale = 3 }}, {UP}", BLUE)


def balls(gap):
    ball = '[[shape]]\ntype = "sphere"\ncenter = [0, 0.7, 0]\nradius = {}\n{}'
    return shape("plane", UP, BLUE) + ball.format(0.6, GLASS) + ball.format(0.6 - gap, RED)


def standing_cylinder(gap):
    steps = f"{{ translate = [0, {gap}, 0] }}"
    tube = f'[[shape]]\ntype = "cylinder"\nradius = 0.7\nz = [0, 1]\ntransform = [{UP}, {steps}]\n{GLASS}'
    return shape("plane", UP, BLUE) + tube


def instances(gap):
    place = '[[shape]]\ntype = "instance"\ngroup = "block"\ntransform = {{ translate = [{}, {}, 0] }}\n'
    group = f'[group.block]\n[[group.block.shape]]\ntype = "box"\ntransform = {{ scale = [0.4, 0.5, 0.6] }}\n{GLASS}'
    return group + shape("plane", UP, BLUE) + place.format(-0.4, 0.5 + gap) + place.format(0.4 + gap, 0.5 + gap)


SCENES = (on_a_plane, stacked, carpets, balls, standing_cylinder, instances)


class Coincident(Case):
    def test_the_image_equals_that_with_gaps(self):
        for scene in SCENES:
            with self.subTest(scene=scene.__name__):
                found, answer = self.render(HEAD + scene(0.0))
                expected, other = self.render(HEAD + scene(GAP))
                swapped = self.render(HEAD + scene(-GAP))[0]
                self.assertEqual((answer["rehits"], other["coincident"]), (0, []))
                self.assertTrue(answer["coincident"])
                self.assertTrue(all(0 < pair["gap"] < 1e-4 for pair in answer["coincident"]), answer["coincident"])

                def differing(one):
                    off = np.zeros(found["R"].shape, dtype=bool)
                    for channel in "RGB":
                        off |= np.abs(found[channel] - one[channel]) > 0.01 * np.maximum(found[channel], one[channel])
                    return int(off.sum())

                self.assertLessEqual(differing(expected), 2)
                self.assertGreater(differing(swapped), 100)

    def test_pairs_are_reported_once(self):
        answer = self.render(HEAD + instances(0.0))[1]
        self.assertEqual([pair["shapes"] for pair in answer["coincident"]], [[0, 1], [0, 2], [1, 2]])

    def test_coincident_surfaces_do_not_block_a_lamp_in_them(self):
        """The lamp lies in both ceilings: the floor is as bright as under one of them."""
        ceiling = shape("rectangle", f"{{ scale = 2 }}, {UP}, {{ translate = [0, 1.5, 0] }}", RED)
        lamp = '[[light]]\ntype = "point"\nposition = [0.2, 1.5, 0.1]\nintensity = 9\n'
        for head in (HEAD, HEAD.replace("max_depth = 8", 'max_depth = 8\nshadows = "filtered"')):
            rest = head + lamp + shape("plane", UP, BLUE)
            one, two = (self.render(rest + ceilings)[0] for ceilings in (ceiling, ceiling + ceiling.replace(RED, BLUE)))
            dark = self.render(rest.replace(lamp, "") + ceiling)[0]
            self.near(two["B"], one["B"], rel=1e-4)
            self.assertGreater((one["B"] > 1.1 * dark["B"]).sum(), 100)

    def test_the_first_of_two_coincident_surfaces_is_visible(self):
        """A rectangle in a face of a body, before and after it in the file; csg is not rebuilt."""
        camera = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [0.25, 0.5, 4], target = [0.25, 0.5, 0] }\n'
        flat = shape("rectangle", "", RED)
        operands = 'operands = [{ type = "box" }, { type = "sphere", radius = 1.5 }]\n'
        for body in (
            '[[shape]]\ntype = "cylinder"\nz = [-1, 0]\n',
            shape("box", "{ translate = [0, 0, -1] }", ""),
            '[[shape]]\ntype = "csg"\noperation = "intersection"\ntransform = { translate = [0, 0, -1] }\n' + operands,
        ):
            for number, scene in enumerate((flat + body, body + flat)):
                with self.subTest(body=body, number=number):
                    self.assertEqual(self.nodes(camera + scene)[0]["shape"], number)

    def test_common_edges_and_wider_gaps_do_not_change(self):
        standing = cuboid([0.5, 0.5, 0.5], [0, 0.5 + 1e-13, 0], GLASS)
        tiles = [shape("rectangle", f"{{ scale = 0.5 }}, {UP}, {{ translate = [{x}, 0, 0] }}", RED) for x in (-0.5, 0.5)]
        for text in (shape("plane", UP, BLUE) + standing, "".join(tiles)):
            with mock.patch.object(coincident, "_change", side_effect=AssertionError):
                self.assertEqual(self.render(HEAD + text)[1]["coincident"], [])

    def test_too_many_faces_are_not_examined(self):
        with mock.patch.object(coincident, "MOST_FACES", 4):
            answer = self.render("# Not cached.\n" + HEAD + stacked(0.0))[1]
        self.assertEqual([list(entry) for entry in answer["coincident"]], [["not_examined"]])


if __name__ == "__main__":
    unittest.main()
