"""Textures and mappings compared with the model's formulas (model §10), on a wall in ambient
light.
"""

import math
import unittest

from support import Case, film, with_povray

SIZE = 12
# Along -z at the square from -1 to 1, which is rotated a little out of z = 0.
WALL = film(SIZE, SIZE) + (
    '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n'
    '[[light]]\ntype = "ambient"\nradiance = 1\n'
    '[[shape]]\ntype = "rectangle"\ntransform = [{ scale = 1.5 }, { rotate = { axis = [0, 1, 0], degrees = 20 } }, { translate = [0, 0.1, 0] }]\n'
    'material = { type = "matte", reflectance = { %s } }\n'
)


def seen():
    """World points and texture coordinates behind the pixels."""
    for j in range(SIZE):
        for i in range(SIZE):
            x, y = (2 * i + 1) / SIZE - 1, 1 - (2 * j + 1) / SIZE
            along = x / math.cos(math.radians(20))
            yield (x, y, -along * math.sin(math.radians(20))), ((along / 1.5 + 1) / 2, ((y - 0.1) / 1.5 + 1) / 2)


def cell(x):
    return math.floor(x + 1 / 4096)


def turn(x, y):
    return math.atan2(y, x) / (2 * math.pi) % 1


def spherical(p):
    x, y, z = p
    return turn(x, y), (math.pi - math.atan2(math.hypot(x, y), z)) / math.pi, 0


def cube(q):
    a = max(range(3), key=lambda axis: (abs(q[axis]), -axis))
    return tuple((q[(a + k) % 3] / abs(q[a]) + 1) / 2 for k in (1, 2)) + (0,)


@with_povray
class Textures(Case):
    def check(self, text, expected):
        pixels = [(i, j) for j in range(SIZE) for i in range(SIZE)]
        found = self.values(WALL % text, pixels)
        for color, (p, uv) in zip(found, seen()):
            self.near(color[:1], [expected(p, uv)], atol=2e-4)
        self.assertGreater(len({round(color[0], 3) for color in found}), 1, text)

    def test_cells(self):
        alike = lambda odd: 0.2 if odd % 2 else 0.8
        self.check(
            'type = "checker3d", scale = 2, offset = [0.3, 0, 1]',
            lambda p, uv: alike(cell(2 * p[0] + 0.3) + cell(2 * p[1]) + cell(2 * p[2] + 1)),
        )
        self.check('type = "stripes", scale = 3, offset = -0.2', lambda p, uv: alike(cell(3 * p[0] - 0.2)))
        self.check('type = "rings", scale = 5, offset = 0.5', lambda p, uv: alike(cell(5 * math.hypot(p[0], p[2]) + 0.5)))
        # A rotation by 90 degrees: rings around z.
        turned = 'mapping = { transform = { rotate = { axis = [1, 0, 0], degrees = 90 } } }'
        self.check(f'type = "rings", scale = 5, {turned}', lambda p, uv: alike(cell(5 * math.hypot(p[0], p[1]))))

    def test_borders_show_one_colour(self):
        scene = film(8, 8) + (
            '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 5, 0], target = [0, 0, 0], up = [0, 0, -1] }\nfov = 20\n'
            '[[light]]\ntype = "ambient"\nradiance = 1\n'
            '[[shape]]\ntype = "rectangle"\ntransform = { rotate = { axis = [1, 0, 0], degrees = -90 } }\n'
            'material = { type = "matte", reflectance = { type = "checker3d" } }\n'
        )  # fmt: skip
        for color, (i, j) in zip(self.values(scene, [(i, j) for j in range(8) for i in range(8)]), ((i, j) for j in range(8) for i in range(8))):
            self.near(color, 0.8 if (i < 4) == (j < 4) else 0.2)

    def test_gradient(self):
        ramp = 'type = "gradient", a = 0, b = 1, scale = 1.5, offset = 0.25'
        x = lambda p: 1.5 * p[0] + 0.25
        self.check(ramp, lambda p, uv: x(p) % 1)
        self.check(f'{ramp}, wrap = "clamp"', lambda p, uv: min(1, max(0, x(p))))
        self.check(f'{ramp}, wrap = "mirror"', lambda p, uv: 1 - abs(x(p) % 2 - 1))
        stops = 'stops = [{ at = 0.2, color = 0.5 }, { at = 0.5, color = 1 }, { at = 0.75, color = 0 }]'

        def three(p, uv):
            t = p[0] % 1
            return 0.5 + 0.5 * min(1, max(0, (t - 0.2) / 0.3)) if t < 0.5 else max(0, 1 - (t - 0.5) / 0.25)

        self.check(f'type = "gradient", {stops}', three)
        self.refuse(WALL % f'type = "gradient", a = 1, {stops}', "scene", "a", "stops")
        self.refuse(WALL % 'type = "gradient", stops = []', "scene", "stops")

    def test_grid_lines(self):
        near = lambda x: abs(x - round(x))
        self.check(
            'type = "grid_lines", scale = [4, 2], width = [0.3, 0.4], offset = [0.1, 0]',
            lambda p, uv: 0.2 if near(4 * uv[0] + 0.1) < 0.15 or near(2 * uv[1]) < 0.2 else 0.8,
        )

    def test_mappings(self):
        checks = lambda u, v: 0.2 if (math.floor(3 * u + 0.07) + math.floor(3 * v + 0.07)) % 2 else 0.8
        lift = lambda p: (p[0] + 0.013, p[1] + 0.027, p[2] + 0.7)
        text = 'type = "checker", scale = 3, offset = [0.07, 0.07], mapping = { %s }'
        moved = ", transform = { translate = [0.013, 0.027, 0.7] }"
        for mapping, place in (
            ('projection = "uv", transform = [{ scale = [2, 3, 1] }]', lambda p, uv: (2 * uv[0], 3 * uv[1])),
            ('projection = "planar"', lambda p, uv: p),
            ('projection = "solid", transform = { rotate = { axis = [0, 1, 0], degrees = 90 } }', lambda p, uv: (p[2], p[1])),
            ('projection = "spherical"' + moved, lambda p, uv: spherical(lift(p))),
            ('projection = "cylindrical"' + moved, lambda p, uv: (turn(*lift(p)[:2]), lift(p)[2])),
            ('projection = "cube"' + moved, lambda p, uv: cube(lift(p))),
        ):
            with self.subTest(mapping=mapping):
                self.check(text % mapping, lambda p, uv: checks(*place(p, uv)[:2]))
        self.refuse(WALL % (text % 'projection = "triplanar"'), "unsupported", "mapping.projection", "normal")

    def test_instances_use_world_space_positions(self):
        ramp = 'type = "gradient", a = 0, b = 1, scale = 0.1, wrap = "clamp"'
        for shape in ('type = "box"', 'type = "csg"\noperation = "union"\noperands = [{ type = "box" }, { type = "sphere" }]'):
            scene = film() + (
                '[camera]\ntype = "orthographic"\nwidth = 0.01\nlook_at = { origin = [4, 0, 9], target = [4, 0, 0] }\n'
                '[[light]]\ntype = "ambient"\nradiance = 1\n'
                f"[[group.g.shape]]\n{shape}\nmaterial = {{ type = \"matte\", reflectance = {{ {ramp} }} }}\n"
                'transform = { rotate = { axis = [0, 0, 1], degrees = 90 } }\n'
                '[[shape]]\ntype = "instance"\ngroup = "g"\ntransform = { translate = [4, 0, 0] }\n'
            )  # fmt: skip
            self.near(self.values(scene)[0], 0.4)


if __name__ == "__main__":
    unittest.main()
