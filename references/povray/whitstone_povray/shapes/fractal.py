"""Twin of the shape `fractal`: POV-Ray's `isosurface` of the logarithm of the last iterate, with
the iterates as nested functions.
"""

from __future__ import annotations

import math
import random
from typing import List, Sequence

from ..fields import REQUIRED
from . import Fields, Place, Solid, Surface, sdl
from ._functions import Functions, number

# Upper bound on nested functions.
MAX_DEPTH = 16
# Longer iterates have escaped for good: from there on, only their lengths are raised to powers.
FAR = 1e6
# Number of points where the slope is sampled; the steepest slope is doubled.
SAMPLES = 10000


def _julia(functions: Functions, c: Sequence[float], depth: int) -> str:
    """A function of four numbers: ln(|z_depth|²/4) / 2^depth, at least its value for an iterate of
    length 1.
    """
    names = ["pa", "pb", "pc", "pd"]
    squared = "(pa*pa+pb*pb+pc*pc+pd*pd)"
    name = functions.declare(names, f"ln(max({squared},1)/4)*{number(0.5**depth)}")
    for left in range(1, depth + 1):
        rest = [f"2*pa*{p}+{number(part)}" for p, part in zip(names[1:], c[1:])]
        step = f"{name}(pa*pa-pb*pb-pc*pc-pd*pd+{number(c[0])},{','.join(rest)})"
        escaped = f"ln({squared})*{number(2.0**left * 0.5**depth)}-{number(math.log(4) * 0.5**depth)}"
        name = functions.declare(names, f"select({squared}-{FAR},{step},{escaped})")
    return name


def _mandelbulb(functions: Functions, power: int, depth: int) -> str:
    """A function of the iterate and its starting point: ln(|z_depth|²/4) / power^depth, at least
    its value for an iterate of length 1.
    """
    names = ["pa", "pb", "pc", "pd", "pe", "pf"]
    squared = "(pa*pa+pb*pb+pc*pc)"
    length = functions.declare(names[:3], f"pow({squared},{number(power / 2)})")
    theta = functions.declare(names[:3], f"{power}*atan2(sqrt(pa*pa+pb*pb),pc)")
    phi = functions.declare(names[:3], f"{power}*atan2(pb,pa)")
    r, t, p = (f"{function}(pa,pb,pc)" for function in (length, theta, phi))
    next_of = [f"{r}*sin({t})*cos({p})+pd", f"{r}*sin({t})*sin({p})+pe", f"{r}*cos({t})+pf"]
    name = functions.declare(names, f"ln(max({squared},1)/4)*{number(float(power) ** -depth)}")
    for left in range(1, depth + 1):
        step = f"{name}({','.join(next_of)},pd,pe,pf)"
        escaped = f"ln({squared})*{number(float(power) ** (left - depth))}-{number(math.log(4) * float(power) ** -depth)}"
        name = functions.declare(names, f"select({squared}-{FAR},{step},{escaped})")
    return functions.declare(names[:3], f"{name}(pa,pb,pc,pa,pb,pc)")


def slopes(kind: str, power: int, depth: int, reach: float, c: Sequence[float], w: float) -> float:
    """The steepest slope of the function per metre, by sampling."""

    def value(point: Sequence[float]) -> float:
        """The same function, evaluated numerically."""
        z = [*point, w]
        unit = float(power) ** -depth
        for left in range(depth, 0, -1):
            squared = sum(part * part for part in z)
            if squared > FAR:
                return math.log(squared) * float(power) ** (left - depth) - math.log(4) * unit
            if kind == "julia":
                a, rest = z[0], z[1:]
                z = [a * a - sum(part * part for part in rest) + c[0], *(2 * a * part + added for part, added in zip(rest, c[1:]))]
            else:
                r = squared ** (power / 2)
                t, p = power * math.atan2(math.hypot(z[0], z[1]), z[2]), power * math.atan2(z[1], z[0])
                turned = [math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t)]
                z = [*(r * part + added for part, added in zip(turned, point)), 0.0]
        return math.log(max(sum(part * part for part in z), 1) / 4) * unit

    source = random.Random(1)
    steepest, step = 0.0, 1e-6
    for _ in range(SAMPLES):
        p: List[float] = [source.uniform(-reach, reach) for _ in range(3)]
        here = value(p)
        ahead = [value([part + step * (k == i) for i, part in enumerate(p)]) for k in range(3)]
        steepest = max(steepest, math.hypot(*((there - here) / step for there in ahead)))
    return steepest


def twin(fields: Fields, place: Place) -> Solid:
    """`kind`, `depth`; `c`, `w`; `power`."""
    kind = fields.choice("kind", REQUIRED, ("julia", "mandelbulb"))
    depth = fields.integer("depth", 8, 1, 30)
    functions = Functions()
    c: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
    power, w = 2, 0.0
    if kind == "julia":
        c = fields.vector("c", REQUIRED, 4)
        w = fields.number("w", 0.0)
        size = math.hypot(*c)
        if size > 2:
            fields.error("c", "expected a quaternion at most 2 long")
        reach = math.sqrt(2 + size)
    else:
        power = fields.integer("power", 8, 2, 16)
        reach = 2.0
        for _ in range(60):
            reach = (2 + reach) ** (1 / power)
    if depth > MAX_DEPTH:
        fields.unsupported(f"POV-Ray has no twin of more than {MAX_DEPTH} iterations", "depth")
        return Solid("union {", Surface("0", "0"), True)
    if kind == "julia":
        name = _julia(functions, c, depth)
        name = functions.declare(["pa", "pb", "pc"], f"{name}(pa,pb,pc,{number(w)})")
    else:
        name = _mandelbulb(functions, power, depth)
    steepest = 2 * slopes(kind, power, depth, reach, c, w)
    container = f"sphere {{ 0, {sdl.number(1.001 * reach * place.setting.scale)} }}"
    return functions.solid(place, name, container, steepest, True)
