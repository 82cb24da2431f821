"""Twin of the shape `isosurface`: POV-Ray's `isosurface`, with the trilinear interpolation as
nested functions.
"""

from __future__ import annotations

import math
import os
import struct
from typing import Callable, List, Optional

from . import Fields, Place, Solid, Surface
from ._functions import Functions, box, number

# Upper bound on the values; POV-Ray has a function for each line of values.
MAX_VALUES = 1 << 14
_MASK = 0xFFFFFFFF


def mix(x: int) -> int:
    """The hash m of the model."""
    x = (x ^ (x >> 16)) * 0x7FEB352D & _MASK
    x = (x ^ (x >> 15)) * 0x846CA68B & _MASK
    return x ^ (x >> 16)


def _noise(size: List[int], seed: int) -> List[float]:
    nx, ny, nz = size
    lines = [mix((seed + i) & _MASK) for i in range(nx)]
    return [
        mix((mix((of_i + j) & _MASK) + k) & _MASK) / 2**32 for k in range(nz) for j in range(ny) for of_i in lines
    ]


def _metaballs(size: List[int], seed: int, count: int) -> List[float]:
    def random(ball: int, a: int) -> float:
        return mix((mix((seed + mix(ball)) & _MASK) + a) & _MASK) / 2**32

    balls = [([random(b, a) - 0.5 for a in range(3)], 0.3 + 0.15 * random(b, 3)) for b in range(count)]
    along = [[2 * i / (n - 1) - 1 for i in range(n)] for n in size]
    found = []
    for z in along[2]:
        for y in along[1]:
            for x in along[0]:
                value = 0.0
                for center, radius in balls:
                    squared = sum((a - b) ** 2 for a, b in zip((x, y, z), center))
                    value += max(0.0, 1 - squared / radius**2) ** 2
                found.append(value)
    return found


def values(fields: Fields, size: List[int]) -> Optional[List[float]]:
    """The densities, x fastest; None if they are invalid."""
    count = math.prod(size)
    sources = [key for key in ("values", "file", "generator") if fields.has(key)]
    if len(sources) != 1:
        fields.error("", "expected exactly one of `values`, `file`, `generator`")
        return None
    if sources[0] == "values":
        found = fields.take("values")
        good = isinstance(found, list) and all(isinstance(v, (int, float)) and math.isfinite(v) for v in found)
        found = [float(v) for v in found] if good else []
    elif sources[0] == "file":
        kind = fields.choice("format", "f32", ("f32", "u8"))
        path = fields.path("file")
        data = b""
        if os.path.isfile(path):
            with open(path, "rb") as file:
                data = file.read()
        each = 4 if kind == "f32" else 1
        found = list(struct.unpack(f"<{len(data) // each}{'f' if kind == 'f32' else 'B'}", data)) if len(data) % each == 0 else []
        if not all(map(math.isfinite, found)):
            found = []
    else:
        seed = fields.integer("seed", 0, 0, _MASK)
        kind = fields.choice("generator", "metaballs", ("metaballs", "noise"))
        if kind == "noise":
            found = _noise(size, seed)
        else:
            found = _metaballs(size, seed, fields.integer("balls", 8, 1, 64))
    if len(found) != count:
        fields.error(sources[0], f"expected {count} finite numbers")
        return None
    return found


def _piecewise(parameter: str, count: int, at: Callable[[int], str]) -> str:
    """Linear interpolation between the values at 0 .. count - 1; each piece is found by bisection.
    """

    def part(low: int, high: int) -> str:
        if high - low == 1:
            return f"({at(low)}*({high}-{parameter})+{at(high)}*({parameter}-{low}))"
        middle = (low + high) // 2
        # Returns the second argument if the first is below 0.
        return f"select({parameter}-{middle},{part(low, middle)},{part(middle, high)})"

    return part(0, count - 1)


def _steepest(size: List[int], found: List[float]) -> float:
    """Upper bound on the gradient of the interpolation, from the largest differences along each
    axis.
    """
    total, step = 0.0, 1
    for axis, n in enumerate(size):
        differences = (abs(found[i + step] - found[i]) for i in range(len(found)) if i // step % n < n - 1)
        total += (max(differences) * (n - 1) / 2) ** 2
        step *= size[axis]
    return 1.0001 * math.sqrt(total)


def twin(fields: Fields, place: Place) -> Solid:
    """`size`, `values`, `file`, `format`, `generator`, `seed`, `balls`, `iso_value`."""
    size = [int(n) for n in fields.vector("size", (0, 0, 0))]
    level = fields.number("iso_value", 0.5)
    nothing = Solid("union {", Surface("0", "0"), True)
    if not all(2 <= n <= 2048 for n in size):
        fields.error("size", "expected three integers from 2 to 2048")
        return nothing
    if math.prod(size) > MAX_VALUES:
        fields.unsupported(f"POV-Ray has no twin of a density with more than {MAX_VALUES} values", "size")
        for key in ("values", "file", "format", "generator", "seed", "balls"):
            fields.take(key)
        return nothing
    found = values(fields, size)
    if found is None:
        return nothing
    # Negative inside. Values equal to the iso value count as outside. POV-Ray does not define this,
    # so they are shifted slightly.
    found = [level - value for value in found]
    little = 1e-10 * max(map(abs, found))
    found = [value if value != 0 else little for value in found]
    nx, ny, nz = size
    functions = Functions()
    planes = []
    for k in range(nz):
        lines = []
        for j in range(ny):
            start = nx * (j + ny * k)
            lines.append(functions.declare(["pa"], _piecewise("pa", nx, lambda i: number(found[start + i]))))
        planes.append(functions.declare(["pa", "pb"], _piecewise("pb", ny, lambda j: f"{lines[j]}(pa)")))
    name = functions.declare(["pa", "pb", "pc"], _piecewise("pc", nz, lambda k: f"{planes[k]}(pa,pb)"))
    cells = [f"({p}+1)*{number((n - 1) / 2)}" for p, n in zip(("pa", "pb", "pc"), size)]
    name = functions.declare(["pa", "pb", "pc"], f"{name}({','.join(cells)})")

    def outside(i: int, j: int, k: int) -> bool:
        return found[i + nx * (j + ny * k)] >= 0

    ends = [(i, j, k) for k in range(nz) for j in range(ny) for i in range(nx) if 0 in (i, j, k) or (i, j, k)[0] == nx - 1 or j == ny - 1 or k == nz - 1]
    closed = all(outside(*vertex) for vertex in ends)
    steepest = _steepest(size, found)
    if steepest == 0:
        return nothing
    return functions.solid(place, name, box(place, (-1, -1, -1), (1, 1, 1)), steepest, closed)
