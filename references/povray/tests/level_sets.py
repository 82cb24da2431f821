"""What the tests of level sets share: a shape that is seen from above."""

from support import Case, film

WHITE = '[[light]]\ntype = "ambient"\nradiance = 1\n'
SEEN = 'material = { type = "matte", reflectance = 1 }\n'
CAMERA = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 9], target = [0, 0, 0] }\nwidth = 4\n'


class SeenFromAbove(Case):
    def seen(self, shape, points, above=None):
        """Whether the shape is seen from above at some points, also beyond a grey rectangle at a
        height.
        """
        size = 400
        sheet = f'[[shape]]\ntype = "rectangle"\ntransform = [{{ scale = 3 }}, {{ translate = [0, 0, {above}] }}]\nmaterial = {{ type = "matte", reflectance = 0.5 }}\n'
        scene = film(size, size) + CAMERA + WHITE + f"[[shape]]\n{shape}\n" + (sheet if above is not None else "")
        # The material precedes the tables of fields.
        scene = scene.replace("SEEN", SEEN)
        pixels = [(int((x + 2) / 4 * size), int((2 - y) / 4 * size)) for x, y in points]
        return [value[0] > 0.75 for value in self.values(scene, pixels)]
