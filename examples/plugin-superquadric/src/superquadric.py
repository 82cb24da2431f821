"""The twin of the superquadric for Whitstone's Mitsuba driver: the shape of `superquadric.rs`,
intersected by another method.

Along a line, N - 1 is convex. Ternary search finds its minimum. If that is negative, bisection on
both sides finds the two intersections. The plugin uses Newton's method instead.
"""

from __future__ import annotations

import numpy as np

from whitstone_mitsuba import twins
from whitstone_mitsuba.surfaces import Crossings, Points, Surface, turn

# Steps of ternary search that narrow any segment within the cube to an ulp.
NARROWING = 130
HALVINGS = 70


class Superquadric(Surface):
    """N(x, y, z) <= 1 with N = ||(||(x, y)||_p, z)||_q, in a space where it extends from -1 to 1.
    """

    def __init__(self, matrix, p, q):
        Surface.__init__(self, matrix)
        self.p, self.q = p, q

    def own_bounds(self):
        return np.zeros(3), np.sqrt(3.0)

    def excess(self, o, d, t):
        """N - 1 at parameters t of lines with origins o and directions d."""
        x, y, z = (np.abs(o[axis] + t * d[axis]) for axis in range(3))
        return norm(norm(x, y, self.p), z, self.q) - 1

    def crossings(self, o, d, start):
        o, d = self.local(o), self.local(d, False)
        started = start.code >= 0
        # The point of the line nearest to the centre, and a segment around it that contains the
        # shape.
        length = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
        middle = -(o[0] * d[0] + o[1] * d[1] + o[2] * d[2]) / length**2
        far = 2 / length
        low, high = middle - far, middle + far
        for _ in range(NARROWING):
            a, b = low + (high - low) / 3, high - (high - low) / 3
            left = self.excess(o, d, a) < self.excess(o, d, b)
            low, high = np.where(left, low, a), np.where(left, b, high)
        least = 0.5 * (low + high)
        meets = self.excess(o, d, least) < 0
        ends = []
        for sign in (-1, 1):
            inside, outside = least, middle + sign * far
            for _ in range(HALVINGS):
                half = 0.5 * (inside + outside)
                within = self.excess(o, d, half) < 0
                inside, outside = np.where(within, half, inside), np.where(within, outside, half)
            ends.append(np.where(meets, 0.5 * (inside + outside), np.inf))
        # A ray that leaves the surface outwards does not hit it again. One that goes inside starts
        # at the first crossing and hits the second.
        first = np.where(started, np.inf, ends[0])
        second = np.where(started & start.outward, np.inf, ends[1])
        count = len(started)
        return Crossings(
            np.column_stack([first, second]),
            np.tile([1, -1], (count, 1)),
            np.zeros((count, 2), dtype=np.int64),
        )

    def points(self, p, code):
        x, y, z = self.local(p)
        rim = norm(np.abs(x), np.abs(y), self.p)
        whole = norm(rim, np.abs(z), self.q)
        # The gradient of N by the chain rule, in powers of ratios, which never overflow.
        across = ratio(rim, whole) ** (self.q - 1)
        n = (
            across * np.sign(x) * ratio(np.abs(x), rim) ** (self.p - 1),
            across * np.sign(y) * ratio(np.abs(y), rim) ** (self.p - 1),
            np.sign(z) * ratio(np.abs(z), whole) ** (self.q - 1),
        )
        normal = self.outward(n)
        up = np.arctan2(z, np.sqrt(x * x + y * y))
        return Points(normal, normal, turn(x, y), 0.5 + up / np.pi, np.zeros(len(code), dtype=np.int64))


def norm(a, b, power):
    """(a^p + b^p)^(1/p) of non-negative numbers, without overflow."""
    most, least = np.maximum(a, b), np.minimum(a, b)
    return most * (1 + ratio(least, most) ** power) ** (1 / power)


def ratio(a, b):
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)


@twins.shape("superquadric")
def read(fields, place, base):
    powers = [2 / fields.number(key, 1.0, lambda e: 0.1 <= e <= 2, f"a {key} from 0.1 to 2") for key in ("east_west", "north_south")]
    radii = fields.vector("radii", (1.0, 1.0, 1.0))
    if min(radii) <= 0:
        fields.error("radii", f"expected radii > 0, found {list(radii)}")
    matrix = place.world @ np.diag([*np.abs(radii), 1.0])
    return Superquadric(matrix, *powers)
