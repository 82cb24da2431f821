"""Twin of the shape `implicit`: POV-Ray's `isosurface` with the same formulas, or its `blob` for
metaballs only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Tuple

from ..fields import REQUIRED
from ..transforms import unit
from . import Fields, Place, Solid, Surface, sdl
from ._functions import Functions, box, number

PARAMETERS = ["pa", "pb", "pc"]
# The largest slope of (1 - r²)², at r = 1/sqrt(3).
KERNEL_SLOPE = 16 / (3 * 3 * math.sqrt(4 / 3))


@dataclass(frozen=True)
class Field:
    """A POV-Ray function."""

    name: str
    # For a number e, the radius of a ball around the origin outside of which the function is at
    # least e.
    reach: Callable[[float], float]
    # A bound on its slope in a ball around the origin.
    slope: Callable[[float], float]


class _Reader:
    """Reads the tree of a field."""

    def __init__(self) -> None:
        self.functions = Functions()

    def make(self, expression: str, reach: Callable[[float], float], slope: Callable[[float], float]) -> Field:
        return Field(self.functions.declare(PARAMETERS, expression), reach, slope)

    def nothing(self) -> Field:
        return self.make("1", lambda _: 0.0, lambda _: 1.0)

    def read(self, table: Any, where: str, context: Any) -> Field:
        """The field of a table with one key."""
        if not isinstance(table, dict) or len(table) != 1:
            context.errors.append(f"{where}: expected a field: a table with one key")
            return self.nothing()
        (kind, inner), place = *table.items(), f"{where}.{next(iter(table))}"
        lists: Dict[str, str] = {"union": "min", "intersection": "max", "difference": "max"}
        if kind in lists:
            return self.join(kind, self.several(inner, place, context))
        read = getattr(self, "_" + kind, None)
        if read is None:
            context.errors.append(f"{place}: no such field")
            return self.nothing()
        fields = Fields(inner, place, context)
        found = read(fields)
        fields.close()
        return found

    def several(self, value: Any, where: str, context: Any) -> List[Field]:
        if not isinstance(value, list) or not value:
            context.errors.append(f"{where}: expected a list of fields")
            return [self.nothing()]
        return [self.read(table, f"{where}[{i}]", context) for i, table in enumerate(value)]

    def inner(self, fields: Fields) -> Field:
        return self.read(fields.take("of", REQUIRED), fields.where + ".of", fields.context)

    def join(self, kind: str, of: List[Field]) -> Field:
        calls = [f"{field.name}(pa,pb,pc)" for field in of]
        if kind == "difference":
            calls = [calls[0]] + [f"-{call}" for call in calls[1:]]
        expression = calls[0]
        for call in calls[1:]:
            expression = f"{'min' if kind == 'union' else 'max'}({expression},{call})"
        reach = {
            "union": lambda e: max(field.reach(e) for field in of),
            "intersection": lambda e: min(field.reach(e) for field in of),
            "difference": lambda e: of[0].reach(e),
        }[kind]
        return self.make(expression, reach, lambda r: max(field.slope(r) for field in of))

    def _sphere(self, fields: Fields) -> Field:
        radius = positive(fields, "radius", 1.0)
        return self.make(f"sqrt(pa*pa+pb*pb+pc*pc)-{number(radius)}", lambda e: radius + e, lambda _: 1.0)

    def _box(self, fields: Fields) -> Field:
        half = positives(fields, "half", (1.0, 1.0, 1.0))
        q = [self.functions.declare(["pa"], f"abs(pa)-{number(h)}") + f"({p})" for h, p in zip(half, PARAMETERS)]
        out = "+".join(f"max({c},0)*max({c},0)" for c in q)
        expression = f"sqrt({out})+min(max(max({q[0]},{q[1]}),{q[2]}),0)"
        return self.make(expression, lambda e: math.hypot(*half) + max(e, 0) * math.sqrt(3), lambda _: 1.0)

    def _torus(self, fields: Fields) -> Field:
        major, minor = positive(fields, "major", 1.0), positive(fields, "minor", 0.25)
        off = self.functions.declare(["pa", "pb"], f"sqrt(pa*pa+pb*pb)-{number(major)}") + "(pa,pb)"
        return self.make(f"sqrt({off}*{off}+pc*pc)-{number(minor)}", lambda e: major + minor + max(e, 0), lambda _: 1.0)

    def _capsule(self, fields: Fields) -> Field:
        a, b = fields.vector("a", REQUIRED), fields.vector("b", REQUIRED)
        radius = positive(fields, "radius", 0.25)
        d = [q - p for p, q in zip(a, b)]
        squared = sum(c * c for c in d)
        if squared == 0:
            fields.error("b", "must differ from a")
            return self.nothing()
        along = "+".join(f"({p}-{number(o)})*{number(c / squared)}" for p, o, c in zip(PARAMETERS, a, d))
        h = self.functions.declare(PARAMETERS, f"min(max({along},0),1)") + "(pa,pb,pc)"
        off = [f"({p}-{number(o)}-{h}*{number(c)})" for p, o, c in zip(PARAMETERS, a, d)]
        expression = f"sqrt({'+'.join(f'{c}*{c}' for c in off)})-{number(radius)}"
        return self.make(expression, lambda e: max(math.hypot(*a), math.hypot(*b)) + radius + max(e, 0), lambda _: 1.0)

    def _plane(self, fields: Fields) -> Field:
        normal = unit(fields.vector("normal", REQUIRED))
        offset = fields.number("offset", 0.0)
        if normal == (0.0, 0.0, 0.0):
            fields.error("normal", "must not have length zero")
        expression = "+".join(f"{p}*{number(c)}" for p, c in zip(PARAMETERS, normal))
        return self.make(f"{expression}-{number(offset)}", lambda _: math.inf, lambda _: 1.0)

    def _metaballs(self, fields: Fields) -> Field:
        threshold, balls = metaballs(fields)
        terms = []
        for center, radius, strength in balls:
            squared = "+".join(f"({p}-{number(c)})*({p}-{number(c)})" for p, c in zip(PARAMETERS, center))
            inside = self.functions.declare(PARAMETERS, f"max(1-({squared})*{number(1 / radius**2)},0)")
            terms.append(self.functions.declare(PARAMETERS, f"{number(strength)}*{inside}(pa,pb,pc)*{inside}(pa,pb,pc)"))
        sum_of_terms = "+".join(f"{term}(pa,pb,pc)" for term in terms)
        around = max(math.hypot(*center) + radius for center, radius, _ in balls)
        steepest = KERNEL_SLOPE * sum(abs(strength) / radius for _, radius, strength in balls)
        return self.make(f"{number(threshold)}-({sum_of_terms})", lambda e: around if e < threshold else math.inf, lambda _: steepest)

    def _smooth_union(self, fields: Fields) -> Field:
        k = positive(fields, "k", REQUIRED)
        of = self.several(fields.take("of", REQUIRED), fields.where + ".of", fields.context)
        h = f"max({number(k)}-abs(pa-pb),0)*{number(1 / k)}"
        join = self.functions.declare(["pa", "pb"], f"min(pa,pb)-({h})*({h})*{number(k / 4)}")
        expression = f"{of[0].name}(pa,pb,pc)"
        for field in of[1:]:
            expression = f"{join}({expression},{field.name}(pa,pb,pc))"
        more = k / 4 * (len(of) - 1)
        return self.make(expression, lambda e: max(f.reach(e + more) for f in of), lambda r: max(f.slope(r) for f in of))

    def _translate(self, fields: Fields) -> Field:
        by, of = fields.vector("by", REQUIRED), self.inner(fields)
        far = math.hypot(*by)
        moved = ",".join(f"{p}-{number(c)}" for p, c in zip(PARAMETERS, by))
        return self.make(f"{of.name}({moved})", lambda e: of.reach(e) + far, lambda r: of.slope(r + far))

    def _rotate(self, fields: Fields) -> Field:
        (x, y, z), angle = unit(fields.vector("axis", REQUIRED)), math.radians(fields.number("degrees", REQUIRED))
        of = self.inner(fields)
        # The inverse rotation, by Rodrigues' formula.
        c, s = math.cos(angle), -math.sin(angle)
        rows = [
            (c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s),
            (y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s),
            (z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)),
        ]
        turned = ",".join("+".join(f"{p}*{number(m)}" for p, m in zip(PARAMETERS, row)) for row in rows)
        return self.make(f"{of.name}({turned})", of.reach, of.slope)

    def _scale(self, fields: Fields) -> Field:
        by, of = positive(fields, "by", REQUIRED), self.inner(fields)
        scaled = ",".join(f"{p}*{number(1 / by)}" for p in PARAMETERS)
        return self.make(f"{number(by)}*{of.name}({scaled})", lambda e: by * of.reach(e / by), lambda r: of.slope(r / by))

    def _twist(self, fields: Fields) -> Field:
        rate = math.radians(fields.number("degrees_per_metre", REQUIRED))
        of = self.inner(fields)
        # A point at height z is rotated clockwise.
        c, s = f"cos(pc*{number(rate)})", f"sin(pc*{number(rate)})"

        def slope(r: float) -> float:
            shear = abs(rate) * r
            return (shear + math.sqrt(shear * shear + 4)) / 2 * of.slope(r)

        return self.make(f"{of.name}(pa*{c}+pb*{s},pb*{c}-pa*{s},pc)", of.reach, slope)

    def _repeat(self, fields: Fields) -> Field:
        period = positives(fields, "period", REQUIRED)
        count = [int(n) for n in fields.vector("count", REQUIRED)]
        of = self.inner(fields)
        if not all(1 <= n <= 64 for n in count) or math.prod(count) > 1024:
            fields.error("count", "expected 1 to 64 along each axis, 1024 in all")
            return self.nothing()
        steps = [[(i - (n - 1) / 2) * p for i in range(n)] for n, p in zip(count, period)]
        expression = ""
        for z in steps[2]:
            for y in steps[1]:
                for x in steps[0]:
                    call = f"{of.name}(pa-{number(x)},pb-{number(y)},pc-{number(z)})"
                    expression = f"min({expression},{call})" if expression else call
        far = math.hypot(*(max(along) for along in steps))
        return self.make(expression, lambda e: of.reach(e) + far, lambda r: of.slope(r + far))


def positive(fields: Fields, key: str, default: Any) -> float:
    """A positive number."""
    return fields.number(key, default, lambda value: value > 0, "a number > 0")


def positives(fields: Fields, key: str, default: Any) -> Tuple[float, ...]:
    """Three positive numbers."""
    found = fields.vector(key, default)
    if not all(value > 0 for value in found):
        fields.error(key, "expected three numbers > 0")
        return (1.0, 1.0, 1.0)
    return found


Ball = Tuple[Tuple[float, ...], float, float]


def metaballs(fields: Fields) -> Tuple[float, List[Ball]]:
    """The threshold, and the balls with centers, radii, strengths."""
    threshold = positive(fields, "threshold", 0.5)
    rows = fields.take("balls", REQUIRED)
    if not isinstance(rows, list) or not 1 <= len(rows) <= 64:
        fields.error("balls", "expected 1 to 64 tables")
        rows = [{"center": [0, 0, 0], "radius": 1}]
    balls = []
    for i, row in enumerate(rows):
        ball = Fields(row, f"{fields.where}.balls[{i}]", fields.context)
        balls.append((ball.vector("center", REQUIRED), positive(ball, "radius", REQUIRED), ball.number("strength", 1.0)))
        ball.close()
    return threshold, balls


def twin(fields: Fields, place: Place) -> Solid:
    """`field`, `bounds`, `lipschitz`."""
    if fields.has("lipschitz"):
        positive(fields, "lipschitz", 1.0)
    tree = fields.take("field", REQUIRED)
    bounds = fields.take("bounds")
    if bounds is None and isinstance(tree, dict) and list(tree) == ["metaballs"]:
        inner = Fields(tree["metaballs"], fields.where + ".field.metaballs", fields.context)
        threshold, balls = metaballs(inner)
        inner.close()
        parts = [
            f"sphere {{ {place.point(center)}, {place.length(radius)}, {sdl.number(strength)} }}" for center, radius, strength in balls
        ]
        return Solid(f"blob {{ threshold {sdl.number(threshold)} {' '.join(parts)}", Surface("0", "0"), True)
    reader = _Reader()
    field = reader.read(tree, fields.where + ".field", fields.context)
    if bounds is None:
        reach = field.reach(0.0)
        if not 0 < reach < math.inf:
            fields.error("bounds", "is required: the region where the field is negative may be unbounded or empty")
            reach = 1.0
        low, high = (-1.001 * reach,) * 3, (1.001 * reach,) * 3
    else:
        box_of = Fields(bounds, fields.where + ".bounds", fields.context)
        low, high = box_of.vector("min", REQUIRED), box_of.vector("max", REQUIRED)
        box_of.close()
        if not all(a < b for a, b in zip(low, high)):
            fields.error("bounds", "expected min below max")
            low, high = (-1.0,) * 3, (1.0,) * 3
    steepest = field.slope(math.hypot(*(max(abs(a), abs(b)) for a, b in zip(low, high))))
    return reader.functions.solid(place, field.name, box(place, low, high), steepest, bounds is None)
