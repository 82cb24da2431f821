"""Shaders (model §8): leaves wrap Mitsuba's BSDFs, composite ones combine other shaders by formula.

A shader gets Mitsuba's surface interaction with the model's frame. Both delta branches have their
full weights: Mitsuba's own `mask` and `blendbsdf` would choose one at random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count
from typing import Any, Optional, Sequence, Tuple

import numpy as np

from . import lights
from .cameras import Lens
from .compounds import by_uv, exact, leaves, smooth, values
from .runtime import dr, mi

FLAGS = {
    "R": mi.BSDFFlags.DeltaReflection,
    # A thin pane is a `Null` for Mitsuba: transmitted rays keep their direction.
    "T": mi.BSDFFlags.DeltaTransmission | mi.BSDFFlags.Null,
}


def opaque_color(value: Sequence[float]) -> Any:
    """A colour that does not become a constant of the kernel."""
    return mi.Color3f(*[dr.opaque(mi.Float, float(component)) for component in value])


@dataclass
class Branch:
    """A delta branch or the transmittance of a shadow ray: the factor, and the media inside and
    outside of the body behind the surface.
    """

    weight: Any
    # In the local frame; None for a shadow ray.
    wo: Any = None
    # Whether there is no interface: the ray stays in its medium.
    straight: Any = True
    inside: Any = None
    outside: Any = None
    # n_t/n_i of a refracted ray.
    eta: Any = None


def _black() -> Any:
    return mi.Color3f(0)


# The part of a step by which the derivative of a normal is measured, in double precision.
SMALL = 1e-6


@dataclass
class Steps:
    """Steps of points, and the normals by which branches are bent with their changes along them, as
    rows in float64: (n, 2, 3), (n, 2, 2), (n, 3) and (n, 2, 3).
    """

    position: np.ndarray
    uv: np.ndarray
    normal: np.ndarray
    change: np.ndarray


class Shader:
    """The default shader, which reflects and emits nothing."""

    def ambient(self, si: Any) -> Any:
        """The factor of the ambient light."""
        return _black()

    def emission(self, si: Any) -> Any:
        """Emitted radiance."""
        return _black()

    def local(self, si: Any, wo: Any) -> Any:
        """The factor of the irradiance from `wo`."""
        return _black()

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        """The delta branch of a kind; `number` selects one of several. None if there is no such
        branch.
        """
        return None

    def shadow(self, si: Any, filtered: bool) -> Branch:
        """Transmittance of a shadow ray, which comes from `si.wi`."""
        return Branch(_black())

    def passes(self, filtered: bool) -> bool:
        """Whether `shadow` can be other than black."""
        return False

    def bends(self, letter: str) -> bool:
        """Whether there is a delta branch of a kind that does not go straight on."""
        return False

    def steps(self, letter: str, si: Any, steps: Steps) -> Steps:
        """The same steps with the normals of a delta branch of a kind."""
        return steps


class Leaf(Shader):
    """A material with its own BSDF."""

    def __init__(self, material: Any, bsdf: Any) -> None:
        self.material, self.bsdf = material, bsdf
        self._ambient = None if material.ambient is None else material.ambient.build()
        self._media = opaque_color(material.interior), opaque_color(material.exterior)
        self._k_refr = material.textures["k_refr"].build() if material.type == "whitted" else None
        self._tint = material.textures["tint"].build() if material.type == "thin_dielectric" else None
        ior = material.numbers
        if "interior_ior" in ior:
            eta = ior["interior_ior"] / ior["exterior_ior"]
            self._eta = dr.opaque(mi.Float, eta)
            self._upward = dr.opaque(mi.Float, max(eta, 1 / eta))

    def ambient(self, si: Any) -> Any:
        return _black() if self._ambient is None else self._ambient.eval(si)

    def local(self, si: Any, wo: Any) -> Any:
        return self.bsdf.eval(mi.BSDFContext(), si, wo)

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        if letter not in self.material.branches or number > 0:
            return None
        context = mi.BSDFContext()
        context.type_mask = FLAGS[letter]
        sample, weight = self.bsdf.sample(context, si, mi.Float(0.5), mi.Point2f(0.5), True)
        straight = self.material.type == "thin_dielectric"
        return Branch(mi.Color3f(weight), sample.wo, straight, *self._media, sample.eta)

    def shadow(self, si: Any, filtered: bool) -> Branch:
        if not self.passes(filtered):
            return Branch(_black())
        cosine = dr.abs(mi.Frame3f.cos_theta(si.wi))
        if self.material.type == "thin_dielectric":
            assert self._tint is not None, "every thin dielectric has a tint"
            r = mi.fresnel(cosine, self._eta)[0]
            return Branch(self._tint.eval(si) * ((1 - r) / (1 + r)))
        if self.material.type == "dielectric":
            # Seen from the side with the lower index, where there is no total internal reflection.
            weight = mi.Color3f(1 - mi.fresnel(cosine, self._upward)[0])
        else:
            assert self._k_refr is not None, "of the other materials, only `whitted` transmits"
            weight = mi.Color3f(self._k_refr.eval(si))
        return Branch(weight, None, False, *self._media)

    def passes(self, filtered: bool) -> bool:
        return filtered and "T" in self.material.branches

    def bends(self, letter: str) -> bool:
        return letter in self.material.branches and not (letter == "T" and self.material.type == "thin_dielectric")


# The frame that is rotated to the normal and the mirror direction: an axis and a vector
# perpendicular to it.
AXIS, ACROSS = (0.48, 0.64, 0.6), (0.8, -0.6, 0.0)


def lobe(n: int, exponent: float) -> np.ndarray:
    """(n², 3): directions about +z through the centres of strata with equal shares of the lobe
    cos^exponent.
    """
    points = Lens(1.0, 1.0, n).points()
    squared = np.sum(points**2, axis=1)
    # The logarithm of the cosine; the sine by `expm1`, for lobes so narrow that the cosine is 1.
    log = np.log1p(-squared) / (exponent + 1)
    sine = np.sqrt(-np.expm1(2 * log))
    around = points / np.sqrt(np.where(squared > 0, squared, 1))[:, None]
    return np.column_stack([sine[:, None] * around, np.exp(log)])


def carried(q: Any, a: Any, b: Any) -> Any:
    """The model's C: rotates `q`, perpendicular to `a`, so that it is perpendicular to `b`."""
    m = a + b
    length = dr.dot(m, m)
    return dr.select(length > 0, q - m * (2 * dr.dot(q, m) / length), q)


def diffuse_transmittance(m: float) -> float:
    """The model's 1 - F of plastic for n_t = m n_i, by Gauss quadrature of its definition."""
    if m < 1:
        return m * m * diffuse_transmittance(1 / m)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    # Panels that shrink towards c = 0, near which R changes fast if the indices are close.
    ends = 2.0 ** -np.arange(64)
    starts = np.append(ends[1:], 0)
    half = (ends - starts) / 2
    c = ((ends + starts) / 2)[:, None] + half[:, None] * nodes
    cos_t = np.sqrt(1 - (1 - c**2) / m**2)
    s, p = c + m * cos_t, m * c + cos_t
    # 1 - R without cancellation: (x + y)² - (x - y)² = 4 x y.
    passed = 2 * m * c * cos_t * (1 / s**2 + 1 / p**2)
    return float(np.sum(half[:, None] * weights * passed * 2 * c))


class Plastic(Leaf):
    """A diffuse base under a smooth coat."""

    def __init__(self, material: Any, bsdf: Any) -> None:
        Leaf.__init__(self, material, bsdf)
        self._reflectance = material.textures["reflectance"].build()
        eta = material.numbers["interior_ior"] / material.numbers["exterior_ior"]
        # Mitsuba divides by this approximation of 1 - F.
        theirs = eta**2 * (1 - mi.fresnel_diffuse_reflectance(mi.Float(1 / eta)).numpy()[0])
        self._scale = dr.opaque(mi.Float, float(theirs / diffuse_transmittance(eta)))

    def ambient(self, si: Any) -> Any:
        cosine = dr.abs(mi.Frame3f.cos_theta(si.wi))
        return Leaf.ambient(self, si) * (1 - mi.fresnel(cosine, self._eta)[0])

    def local(self, si: Any, wo: Any) -> Any:
        return self._reflectance.eval(si) * (self._scale * Leaf.local(self, si, wo))


class Over(Shader):
    """The same as another material."""

    def __init__(self, under: Shader) -> None:
        self.under = under

    def ambient(self, si: Any) -> Any:
        return self.under.ambient(si)

    def emission(self, si: Any) -> Any:
        return self.under.emission(si)

    def local(self, si: Any, wo: Any) -> Any:
        return self.under.local(si, wo)

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        return self.under.branch(letter, si, number)

    def shadow(self, si: Any, filtered: bool) -> Branch:
        return self.under.shadow(si, filtered)

    def passes(self, filtered: bool) -> bool:
        return self.under.passes(filtered)

    def bends(self, letter: str) -> bool:
        return self.under.bends(letter)

    def steps(self, letter: str, si: Any, steps: Steps) -> Steps:
        return self.under.steps(letter, si, steps)


class Rough(Over):
    """A material whose branches are spread over directions."""

    def __init__(self, numbers: Any, under: Shader) -> None:
        Over.__init__(self, under)
        self.lobe = lobe(int(numbers["samples"]), numbers["exponent"])

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        found = None if number >= len(self.lobe) else self.under.branch(letter, si)
        if found is None:
            return None
        # The normal on the side that the branch goes to.
        n = mi.Vector3f(si.sh_frame.n)
        n = dr.select(si.wi.z < 0, -n, n)
        n = n if letter == "R" else -n
        d = mi.Vector3f(si.to_world(found.wo))
        axis, across = (mi.Vector3f(opaque_color(vector)) for vector in (AXIS, ACROSS))
        x = carried(carried(across, axis, n), n, d)
        # Already perpendicular, except for rounding next to the pole.
        x = dr.normalize(x - dr.dot(x, d) * d)
        y = dr.cross(d, x)
        a, b, c = opaque_color(self.lobe[number])
        weight = found.weight * dr.opaque(mi.Float, 1 / len(self.lobe))
        return replace(found, weight=weight, wo=si.to_local(a * x + b * y + c * d))


class Emissive(Over):
    """Emission on top of another material."""

    def __init__(self, radiance: Any, under: Shader) -> None:
        Over.__init__(self, under)
        self.radiance = radiance.build()

    def emission(self, si: Any) -> Any:
        return self.radiance.eval(si) + self.under.emission(si)


class ReflectionMap(Over):
    """A material whose reflections are looked up in a map."""

    def __init__(self, directions: Any, under: Shader) -> None:
        Over.__init__(self, under)
        self.directions = directions.build()

    def emission(self, si: Any) -> Any:
        total = mi.Color3f(self.under.emission(si))
        n, v = mi.Vector3f(si.n), si.to_world(si.wi)
        for number in count():
            branch = self.under.branch("R", si, number)
            if branch is None:
                return total
            d = mi.Vector3f(si.to_world(branch.wo))
            dr.eval(d)
            seen = self.directions.eval(lights.place(np.array(d).T))
            # Rule G.
            kept = dr.dot(n, d) * dr.dot(n, v) > 0
            total = total + dr.select(kept, branch.weight * seen, _black())

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        return None if letter == "R" else self.under.branch(letter, si, number)

    def bends(self, letter: str) -> bool:
        return letter != "R" and self.under.bends(letter)


def _straight(si: Any, weight: Any) -> Branch:
    return Branch(weight, -si.wi)


class Mask(Shader):
    """A material with an opacity; the rest of the light passes straight through."""

    def __init__(self, opacity: Any, inner: Shader) -> None:
        self.opacity, self.inner = opacity.build(), inner

    def _opacity(self, si: Any) -> Any:
        return mi.Color3f(self.opacity.eval(si))

    def ambient(self, si: Any) -> Any:
        return self._opacity(si) * self.inner.ambient(si)

    def emission(self, si: Any) -> Any:
        return self._opacity(si) * self.inner.emission(si)

    def local(self, si: Any, wo: Any) -> Any:
        return self._opacity(si) * self.inner.local(si, wo)

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        opacity, branch = self._opacity(si), self.inner.branch(letter, si, number)
        if letter == "R":
            return None if branch is None else Branch(opacity * branch.weight, branch.wo)
        if number > 0:
            return None
        behind = 1 - opacity
        return _straight(si, behind if branch is None else behind + opacity * branch.weight)

    def shadow(self, si: Any, filtered: bool) -> Branch:
        opacity = self._opacity(si)
        return Branch(1 - opacity + opacity * self.inner.shadow(si, filtered).weight)

    def passes(self, filtered: bool) -> bool:
        return True

    def bends(self, letter: str) -> bool:
        return letter == "R" and self.inner.bends(letter)

    def steps(self, letter: str, si: Any, steps: Steps) -> Steps:
        return self.inner.steps(letter, si, steps)


class Mix(Shader):
    """A weighted mixture of two materials."""

    def __init__(self, weight: Any, a: Shader, b: Shader) -> None:
        self.weight, self.parts = weight.build(), (a, b)

    def _sum(self, si: Any, values: Sequence[Any]) -> Any:
        share = mi.Color3f(self.weight.eval(si))
        return (1 - share) * values[0] + share * values[1]

    def ambient(self, si: Any) -> Any:
        return self._sum(si, [part.ambient(si) for part in self.parts])

    def emission(self, si: Any) -> Any:
        return self._sum(si, [part.emission(si) for part in self.parts])

    def local(self, si: Any, wo: Any) -> Any:
        return self._sum(si, [part.local(si, wo) for part in self.parts])

    def _combine(self, si: Any, branches: Sequence[Optional[Branch]]) -> Optional[Branch]:
        there = [branch for branch in branches if branch is not None]
        if not there:
            return None
        # Either both bend rays to the same direction, or only one of them bends rays.
        bent = [branch for branch in there if branch.straight is not True]
        chosen = (bent or there)[0]
        weight = self._sum(si, [_black() if branch is None else branch.weight for branch in branches])
        return Branch(weight, chosen.wo, chosen.straight, chosen.inside, chosen.outside, chosen.eta)

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        return self._combine(si, [part.branch(letter, si, number) for part in self.parts])

    def shadow(self, si: Any, filtered: bool) -> Branch:
        # The medium behind an opaque part does not count.
        branches = [part.shadow(si, filtered) if part.passes(filtered) else None for part in self.parts]
        return self._combine(si, branches) or Branch(_black())

    def passes(self, filtered: bool) -> bool:
        return any(part.passes(filtered) for part in self.parts)

    def bends(self, letter: str) -> bool:
        return any(part.bends(letter) for part in self.parts)

    def steps(self, letter: str, si: Any, steps: Steps) -> Steps:
        # If one part has a normal of its own, the other one bends no rays.
        bent = [part for part in self.parts if part.bends(letter)]
        return bent[0].steps(letter, si, steps) if bent else steps


class TwoSided(Shader):
    """One material for the outside, another one for the inside."""

    def __init__(self, front: Shader, back: Shader) -> None:
        self.parts = front, back

    def _choose(self, si: Any, values: Sequence[Any]) -> Any:
        outside = dr.dot(mi.Vector3f(si.n), si.to_world(si.wi)) > 0
        return dr.select(outside, values[0], values[1])

    def ambient(self, si: Any) -> Any:
        return self._choose(si, [part.ambient(si) for part in self.parts])

    def emission(self, si: Any) -> Any:
        return self._choose(si, [part.emission(si) for part in self.parts])

    def local(self, si: Any, wo: Any) -> Any:
        return self._choose(si, [part.local(si, wo) for part in self.parts])

    def _combine(self, si: Any, branches: Sequence[Optional[Branch]]) -> Optional[Branch]:
        there = [branch for branch in branches if branch is not None]
        if not there:
            return None
        some = there[0]

        def both(read: Any, other: Any) -> Any:
            values = [other if branch is None or read(branch) is None else read(branch) for branch in branches]
            return self._choose(si, values)

        wo = None if some.wo is None else both(lambda branch: branch.wo, some.wo)
        straight: Any = True
        if any(branch.straight is not True for branch in there):
            straight = both(lambda branch: mi.Bool(branch.straight), mi.Bool(True))
        inside, outside = (both(lambda branch, side=side: getattr(branch, side), _black()) for side in ("inside", "outside"))
        eta = both(lambda branch: branch.eta, mi.Float(1)) if any(branch.eta is not None for branch in there) else None
        return Branch(both(lambda branch: branch.weight, _black()), wo, straight, inside, outside, eta)

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        return self._combine(si, [part.branch(letter, si, number) for part in self.parts])

    def shadow(self, si: Any, filtered: bool) -> Branch:
        return self._combine(si, [part.shadow(si, filtered) for part in self.parts]) or Branch(_black())

    def passes(self, filtered: bool) -> bool:
        return any(part.passes(filtered) for part in self.parts)

    def bends(self, letter: str) -> bool:
        return any(part.bends(letter) for part in self.parts)

    def steps(self, letter: str, si: Any, steps: Steps) -> Steps:
        front, back = (part.steps(letter, si, steps) for part in self.parts)
        outside = np.array(dr.dot(mi.Vector3f(si.n), si.to_world(si.wi)) > 0)
        return replace(
            steps,
            normal=np.where(outside[:, None], front.normal, back.normal),
            change=np.where(outside[:, None, None], front.change, back.change),
        )


class NormalMapped(Shader):
    """A material in a frame about another normal."""

    def __init__(self, inner: Shader) -> None:
        self.inner = inner

    def normal(self, si: Any, n: Any) -> Any:
        """The normal that replaces `n`; zero if there is none."""
        raise NotImplementedError

    def precisely(self, si: Any, place: Any, n: np.ndarray) -> np.ndarray:
        """The same as `normal` at a place near that of `si`, (3, n) in double precision."""
        raise NotImplementedError

    def _turned(self, si: Any) -> Any:
        return self._turn(si)[0]

    def _turn(self, si: Any) -> Tuple[Any, Any]:
        """The interaction with the other normal, and where it has one."""
        v, n = si.to_world(si.wi), mi.Vector3f(si.sh_frame.n)
        found = self.normal(si, n)
        length = dr.norm(found)
        found = found / length
        good = (length > 0) & dr.isfinite(length) & (dr.dot(found, v) * dr.dot(mi.Vector3f(si.n), v) > 0)
        turned = mi.SurfaceInteraction3f(si)
        turned.sh_frame = mi.Frame3f(dr.select(good, found, n))
        turned.wi = turned.to_local(v)
        return turned, good

    def ambient(self, si: Any) -> Any:
        return self.inner.ambient(self._turned(si))

    def emission(self, si: Any) -> Any:
        return self.inner.emission(self._turned(si))

    def local(self, si: Any, wo: Any) -> Any:
        turned = self._turned(si)
        return self.inner.local(turned, turned.to_local(si.to_world(wo)))

    def branch(self, letter: str, si: Any, number: int = 0) -> Optional[Branch]:
        turned = self._turned(si)
        branch = self.inner.branch(letter, turned, number)
        if branch is None:
            return None
        return replace(branch, wo=si.to_local(turned.to_world(branch.wo)))

    def shadow(self, si: Any, filtered: bool) -> Branch:
        return self.inner.shadow(self._turned(si), filtered)

    def passes(self, filtered: bool) -> bool:
        return self.inner.passes(filtered)

    def bends(self, letter: str) -> bool:
        return self.inner.bends(letter)

    def steps(self, letter: str, si: Any, steps: Steps) -> Steps:
        turned, good = self._turn(si)
        p, uv, normal = (np.array(array, dtype=np.float64) for array in (si.p, si.uv, turned.sh_frame.n))

        def displaced(side: int, part: float) -> np.ndarray:
            """The unit normal at this part of the step."""
            n = (steps.normal + part * steps.change[:, side]).T
            n = n / np.linalg.norm(n, axis=0)
            place = _Place(p + part * steps.position[:, side].T, uv + part * steps.uv[:, side].T, _Frame(n))
            found = self.precisely(si, place, n)
            return (found / np.linalg.norm(found, axis=0)).T

        with np.errstate(all="ignore"):
            change = np.stack([(displaced(side, SMALL) - displaced(side, -SMALL)) / (2 * SMALL) for side in (0, 1)], axis=1)
        taken = np.array(good)[:, None]
        return self.inner.steps(
            letter, turned,
            replace(
                steps,
                normal=np.where(taken, normal.T, steps.normal),
                change=np.where(taken[:, :, None], change, steps.change),
            ),
        )  # fmt: skip


class NormalMap(NormalMapped):
    """Normals encoded as colours."""

    def __init__(self, map_: Any, material: Any, table: Any, inner: Shader) -> None:
        NormalMapped.__init__(self, inner)
        self.map, self.around = map_.build(), material.around
        self.direction = mi.Vector3f(opaque_color(material.direction))
        # The attributes of vertices, if the tangent is that of the mesh.
        self.table = table if material.mesh_tangent else None
        self.strength = dr.opaque(mi.Float, float(material.numbers.get("strength", 1.0)))
        self.smooth, self.numbers = smooth(map_), (np.array(material.direction, dtype=np.float64), float(material.numbers.get("strength", 1.0)))

    def normal(self, si: Any, n: Any) -> Any:
        x, h = (self.direction, mi.Float(1)) if self.table is None else self.table.tangents(si)
        t = dr.cross(x, n) if self.around else x - dr.dot(x, n) * n
        # Rounding must not give a direction to what has no length.
        t = dr.select(dr.norm(t) > dr.opaque(mi.Float, 1e-6), dr.normalize(t), mi.Vector3f(0))
        m = 2 * mi.Color3f(self.map.eval(si)) - 1
        found = self.strength * (m.x * t + m.y * h * dr.cross(n, t)) + m.z * n
        return dr.select(dr.norm(t) > 0, found, mi.Vector3f(0))

    def precisely(self, si: Any, place: Any, n: np.ndarray) -> np.ndarray:
        (x, strength), h = self.numbers, np.ones(1)
        x = np.broadcast_to(x[:, None], n.shape)
        if self.table is not None:
            x, h = (np.array(array, dtype=np.float64) for array in self.table.tangents(si))
        t = np.cross(x, n, axis=0) if self.around else x - np.sum(x * n, axis=0) * n
        t = t / np.linalg.norm(t, axis=0)
        m = 2 * values(self.smooth, si, place).T - 1
        return strength * (m[0] * t + m[1] * h * np.cross(n, t, axis=0)) + m[2] * n


class BumpVectors(NormalMap):
    """Vectors encoded as colours, added to the normal: in world space, or in the frame of a normal
    map.
    """

    def __init__(self, material: Any, table: Any, inner: Shader) -> None:
        NormalMap.__init__(self, material.textures["vectors"], material, table, inner)
        self.tangent = material.tangent
        self.factor = float(material.numbers["scale"])
        self.scale = dr.opaque(mi.Float, self.factor)

    def normal(self, si: Any, n: Any) -> Any:
        if self.tangent:
            return n + self.scale * NormalMap.normal(self, si, n)
        return n + self.scale * mi.Vector3f(2 * mi.Color3f(self.map.eval(si)) - 1)

    def precisely(self, si: Any, place: Any, n: np.ndarray) -> np.ndarray:
        vector = NormalMap.precisely(self, si, place, n) if self.tangent else 2 * values(self.smooth, si, place).T - 1
        return n + self.factor * vector


@dataclass
class _Frame:
    """A shading frame of which only the normal is known."""

    n: Any


@dataclass
class _Place:
    """The point data that mappings need, in double precision."""

    p: Any
    uv: Any
    sh_frame: Any


class Bump(NormalMapped):
    """A bump map: a height as a function of the world-space position and of (u, v)."""

    def __init__(self, height: Any, scale: float, step: float, inner: Shader) -> None:
        NormalMapped.__init__(self, inner)
        self.height, self.smooth = exact(height), smooth(height)
        # Constants and vertex colours have no slope and no mapping.
        self.flat = not any(hasattr(leaf, "mapping") for leaf in leaves(height))
        self.by_uv = by_uv(height)
        self.scale, self.step = scale, step

    def normal(self, si: Any, n: Any) -> Any:
        if self.flat:
            return n
        raised = self._raised(self.height, si, si, np.array(n, dtype=np.float64))
        return mi.Vector3f(np.ascontiguousarray(raised.astype(np.float32)))

    def precisely(self, si: Any, place: Any, n: np.ndarray) -> np.ndarray:
        return n if self.flat else self._raised(self.smooth, si, place, n)

    def _raised(self, height: Any, si: Any, place: Any, normal: np.ndarray) -> np.ndarray:
        p = np.array(place.p, dtype=np.float64)
        gradient = np.zeros_like(p)
        for axis in range(3):
            for sign in (1, -1):
                beside = p.copy()
                beside[axis] += sign * self.step
                gradient[axis] += sign * values(height, si, _Place(beside, place.uv, place.sh_frame))[:, 0]
        if self.by_uv:
            uv = np.array(place.uv, dtype=np.float64)
            # The gradients of u and of v: see `footprints`.
            for axis, along in enumerate((si.dp_du, si.dp_dv)):
                difference = np.zeros(uv.shape[1])
                for sign in (1, -1):
                    beside = uv.copy()
                    beside[axis] += sign * self.step
                    difference += sign * values(height, si, _Place(place.p, beside, place.sh_frame))[:, 0]
                gradient += difference * np.array(along, dtype=np.float64)
        gradient = gradient * (self.scale / (2 * self.step))
        return normal - (gradient - np.sum(gradient * normal, axis=0) * normal)


def spread(material: Any, under: Shader) -> Shader:
    """A shader whose branches are spread by the lobe of a material."""
    return Rough(material.numbers, under) if material.numbers["samples"] > 1 else under


def build(materials: Sequence[Any], bsdfs: Sequence[Any], table: Any) -> Tuple[Shader, ...]:
    """A shader for each material; parts come before the composites that use them. `table` contains
    the attributes of vertices.
    """
    built: list = []
    for material, bsdf in zip(materials, bsdfs):
        parts = [built[number] for number in material.parts]
        if material.type == "emissive":
            built.append(Emissive(material.textures["radiance"], parts[0] if parts else Shader()))
        elif material.type == "reflection_map":
            built.append(ReflectionMap(material.directions, parts[0]))
        elif material.type == "mask":
            built.append(Mask(material.textures["opacity"], parts[0]))
        elif material.type == "mix":
            built.append(Mix(material.textures["weight"], *parts))
        elif material.type == "two_sided":
            built.append(TwoSided(*parts))
        elif material.type == "normal_map":
            built.append(NormalMap(material.textures["map"], material, table, parts[0]))
        elif material.type == "bump" and "vectors" in material.textures:
            built.append(BumpVectors(material, table, parts[0]))
        elif material.type == "bump":
            built.append(Bump(material.textures["height"], material.numbers["scale"], material.numbers["step"], parts[0]))
        elif material.type == "rough":
            built.append(spread(material, parts[0]))
        elif material.type == "plastic":
            built.append(spread(material, Plastic(material, bsdf)))
        elif material.type == "glossy":
            built.append(spread(material, Leaf(material, bsdf)))
        else:
            built.append(Leaf(material, bsdf))
    return tuple(built)
