"""Images by Mitsuba's own C++ integrators on the driver's camera rays (op `stock`).

Stock sensors jitter their rays, so `Integrator.sample` gets the rays of the model. Everything else
is Mitsuba's: intersections, offsets of spawned rays, emitter sampling and, for native materials,
BSDFs.

- If every surface is lit directly only, the image is the sum of `direct` with each light alone (of
  several, the integrator would choose one at random) and of the directly visible background (`path`
  of depth 1).
- If every surface only reflects or refracts, it is `path`, which follows one random branch per hit.
- If such a scene has dielectrics that absorb, it is `volpathmis`. Their sides become homogeneous
  media of albedo 0, whose extinction is the absorption coefficient.

Other scenes have no stock integrator: `path` adds light between diffuse surfaces, and `direct`
follows no reflections.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, List, Tuple

import numpy as np

from whitstone_protocol.errors import Unsupported

from . import compounds, patterns, shapes
from .document import Document
from .driver import LANES, Tracer
from .fields import Vector
from .lanes import pad
from .levels import Level, Rays
from .materials import Material
from .runtime import dr, mi
from .scene import Built, load_shapes
from .settings import Setting
from .textures import Constant

# Materials that are lit by the lights only, and those that only reflect or refract rays.
LIT = ("matte", "phong", "blinn_phong", "whitted", "tabulated")
SPECULAR = ("mirror", "conductor", "dielectric", "thin_dielectric")

# Camera rays per pixel of `volpathmis`, as a multiple of the repeats. A path survives a medium or
# does not, so its variance is about 20 times that of `path` in the same scene.
VOLUME_SAMPLES = 16
# Largest mean throughput of the rays that are in another medium than Mitsuba's path; it bounds the
# relative difference of the images under a uniform background.
STRAY = 1e-4


@dataclass
class Term:
    """An integrator with the emitters that it sees; the image is the sum of all terms."""

    integrator: Dict[str, Any]
    emitters: List[Any]


@dataclass
class Image:
    """Means and variances of one sample, (n, 3) float64, with their origin."""

    mean: np.ndarray
    variance: np.ndarray
    repeats: int
    integrator: str


def why_not(document: Document) -> List[str]:
    """The reasons why Mitsuba's own integrators cannot render a scene."""
    reasons: List[str] = []
    if any(shape.surface is not None for shape in document.shapes):
        reasons.append("shape: Mitsuba's own scene lacks the shapes that the driver intersects by itself")
    materials = [document.materials[number] for number in sorted(document.used())]
    others = sorted({material.type for material in materials} - set(LIT) - set(SPECULAR))
    if others:
        reasons.append(f"material: the driver composes {', '.join(others)}; Mitsuba's integrators do not know it")
    if any(material.priority is not None for material in materials):
        reasons.append("material: Mitsuba has no priorities of bodies that overlap")
    follows = document.integrator.follow
    lit = [material for material in materials if material.type in LIT]
    if follows and any(material.branches for material in materials):
        if lit:
            reasons.append("integrator: path lights diffuse surfaces indirectly, and direct follows no reflections")
        if _absorbs(document) and any(material.type == "thin_dielectric" for material in materials):
            reasons.append("material: Mitsuba's volume integrators count no bounce where a ray passes a thin_dielectric")
        if any(shape.rules.flip and document.materials[shape.material].refracts for shape in document.shapes):
            reasons.append("shape: a mirrored sphere or rectangle has its inside where Mitsuba has its outside")
        if document.integrator.limit_background or document.integrator.min_contribution > 0:
            reasons.append("integrator: Mitsuba sees black beyond the last bounce, and cuts off no faint branches")
    if not document.integrator.shadows:
        reasons.append("integrator: Mitsuba always has shadows")
    elif document.integrator.filtered and any("T" in material.branches for material in materials):
        reasons.append("integrator: Mitsuba's shadows are opaque")
    if document.integrator.light_cutoff > 0:
        reasons.append("integrator: Mitsuba cuts off no faint lights")
    if document.integrator.gouraud:
        reasons.append("integrator: Mitsuba does not interpolate the colours of vertices")
    if max(document.lights.ambient) > 0 and any(material.ambient is not None for material in materials):
        reasons.append("light: Mitsuba has no ambient light")
    if document.lights.environments:
        reasons.append("light: the driver looks up environments by itself")
    if document.samples.refinement is not None:
        reasons.append("sampler: the number of samples depends on the image")
    if document.footprints:
        reasons.append("texture: Mitsuba has no filters over the footprint of a ray")
    if any(lamp.slide is not None for lamp in document.lights.lamps):
        reasons.append("light: the image of a projector or spot light is looked up in Python, which Mitsuba's integrators cannot call")
    looks = [texture for material in materials for texture in material.textures.values()]
    if any(is_python(texture) for texture in looks):
        reasons.append("texture: it is computed in Python, which Mitsuba's integrators cannot call")
    for shape in document.shapes:
        textures = document.materials[shape.material].textures.values()
        if shape.rules.uv != shapes.UV_NATIVE and any(_lies_by_uv(texture) for texture in textures):
            reasons.append(f"shape: Mitsuba has other texture coordinates on a {shape.type}")
            break
    return reasons


def check(document: Document) -> None:
    """Refuses scenes that Mitsuba's own integrators cannot render.

    Call it before the scene is built. Dr.Jit records the code of all objects of the process, so a
    Python texture that merely exists would break the integrators too.
    """
    reasons = why_not(document)
    if reasons:
        raise Unsupported("\n".join(reasons))


def is_python(texture: Any) -> bool:
    """Whether the twin of a texture uses NumPy, which code that Dr.Jit records cannot."""
    if isinstance(texture, Constant):
        return False
    if isinstance(texture, compounds.HOSTED):
        return True
    return isinstance(texture, patterns.HOSTED) or not texture.mapping.usual() or getattr(texture, "folded", False)


def _lies_by_uv(texture: Any) -> bool:
    return compounds.by_uv(texture)


def _absorbs(document: Document) -> bool:
    """Whether rays that are followed may enter a medium."""
    materials = [document.materials[number] for number in document.used()]
    return document.integrator.follow and any(max(material.interior + material.exterior) > 0 for material in materials)


def _media(material: Material) -> shapes.Media:
    """The media of a material, by side."""
    sides = {"interior": material.interior, "exterior": material.exterior}
    return {side: _medium(absorption) for side, absorption in sides.items() if max(absorption) > 0}


def _medium(absorption: Vector) -> "mi.Medium":
    """A medium that absorbs and does not scatter."""
    # Mitsuba's RGB values are at most 1; a scale gives the rest.
    scale = max(absorption)
    extinction = {"type": "rgb", "value": [value / scale for value in absorption]}
    return mi.load_dict({"type": "homogeneous", "albedo": 0.0, "sigma_t": extinction, "scale": scale, "sample_emitters": False})


def _check_media(tracer: Tracer, rays: Rays) -> None:
    """Refuses a scene in which a ray arrives at a dielectric in another medium than that of the
    side that it hits.

    The model keeps the medium of a ray that is reflected, and starts camera rays in none. Mitsuba
    takes both from the shape. They differ if the camera is in a medium, if a mesh is not closed, or
    if a body in a medium does not name it as its exterior.
    """
    document = tracer.document
    total, stray = rays.real, 0.0
    pending = [(rays, 0)]
    while pending:
        rays, depth = pending.pop()
        level, children = tracer.level(rays, depth)
        stray += _stray(document, level)
        if stray > STRAY * total:
            raise Unsupported("material: a ray is in another medium than that of the side of the dielectric that it hits")
        if children is not None:
            parts = range(0, children.real, tracer.lanes)
            pending += [(children.gather(np.arange(first, min(first + tracer.lanes, children.real))), depth + 1) for first in parts]


def _stray(document: Document, level: Level) -> float:
    """The sum of the throughputs of the rays that `_check_media` refuses."""
    hits, rays = level.hits, level.rays
    numbers = hits.material.numpy()[: rays.real]
    outside = (dr.dot(hits.n_g, rays.d) < 0).numpy()[: rays.real]
    medium, throughput = rays.medium.numpy().T[: rays.real], hits.throughput.numpy().T[: rays.real].max(axis=1)
    total = 0.0
    for number in document.used():
        material = document.materials[number]
        if material.refracts:
            here = numbers == number
            sides = np.where(outside[here, None], material.exterior, material.interior).astype(np.float32)
            total += float(throughput[here][(sides != medium[here]).any(axis=1)].sum())
    return total


def _terms(built: Built) -> Tuple[str, List[Term]]:
    """The name of the integrator, and all terms."""
    document = built.document
    sky = [built.background] if max(document.lights.background) > 0 else []
    branches = any(document.materials[number].branches for number in document.used())
    if document.integrator.follow and branches:
        depth = document.integrator.max_depth + 1
        # One path serves all channels. `volpath` samples distances by one of them; `volpathmis`
        # weighs by the mean of their probabilities, whose variance is never larger.
        name = "volpathmis" if _absorbs(document) else "path"
        # No Russian roulette: it would only add noise.
        return name, [Term({"type": name, "max_depth": depth, "rr_depth": depth + 1}, sky)]
    terms = [Term({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}, [emitter]) for emitter in built.emitters]
    if sky:
        terms.append(Term({"type": "path", "max_depth": 1, "rr_depth": 2}, sky))
    return "direct", terms


def render(built: Built, setting: Setting, repeats: int) -> Image:
    """The image of a scene that passes `check`."""
    document = built.document
    name, terms = _terms(built)
    samples = len(document.samples)
    if name == "direct":
        # Nothing in it is random: lights are points, and each is sampled separately.
        repeats = min(repeats, 2)
    elif name == "volpathmis":
        repeats *= math.ceil(VOLUME_SAMPLES / samples)
    media = [_media(material) for material in document.materials] if name == "volpathmis" else None
    loaded = []
    for term in terms:
        extra = {f"zz_emitter{number}": emitter for number, emitter in enumerate(term.emitters)}
        loaded.append((mi.load_dict(term.integrator), load_shapes(document, built.bsdfs, setting, extra, media)[0]))
    tracer = Tracer(built, [setting])
    step = max(1, LANES // samples)
    count = document.width * document.height
    total, squares = np.zeros((count, 3)), np.zeros((count, 3))
    # Seeds differ between launches: pixels in different launches are then independent.
    launches = 0
    for first in range(0, count, step):
        pixels = np.arange(first, min(first + step, count))
        which = np.zeros(len(pixels), dtype=np.int64)
        rays = tracer.camera_rays(pixels % document.width, pixels // document.width, which, document.samples)
        if media is not None:
            _check_media(tracer, rays)
        # Small images repeat all their rays in one launch, which costs less than many launches.
        most = max(1, LANES // rays.real)
        for start in range(0, repeats, most):
            copies = min(most, repeats - start)
            value = sum(_sample(integrator, scene, rays, copies, launches) for integrator, scene in loaded)
            launches += 1
            if not loaded:
                value = np.zeros((copies * rays.real, 3))
            value = value.reshape(copies, len(pixels), samples, 3).mean(axis=2)
            total[pixels] += value.sum(axis=0)
            squares[pixels] += (value * value).sum(axis=0)
    mean = total / repeats
    variance = np.maximum(squares - repeats * mean * mean, 0) / max(1, repeats - 1)
    # A variance that comes from rounding equal values is no noise.
    variance[variance < 1e-12 * mean * mean] = 0
    return Image(mean, variance, repeats, name)


def _sample(integrator: "mi.Integrator", scene: "mi.Scene", rays: Rays, copies: int, seed: int) -> np.ndarray:
    """(copies * n, 3) float64: `Integrator.sample` along each ray, for all rays one copy after the
    other.
    """
    count = copies * rays.real
    lanes = pad(np.tile(np.arange(rays.real), copies))
    ray = mi.RayDifferential3f(mi.Ray3f(dr.gather(mi.Point3f, rays.o, lanes), dr.gather(mi.Vector3f, rays.d, lanes)))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, dr.width(lanes))
    value, _, _ = integrator.sample(scene, sampler, ray)
    return np.array(mi.Color3f(value), dtype=np.float64).reshape(3, -1).T[:count]
