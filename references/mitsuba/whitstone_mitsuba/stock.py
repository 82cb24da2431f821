"""Images by Mitsuba's own C++ integrators on the driver's camera rays (op `stock`).

Stock sensors jitter their rays, so `Integrator.sample` gets the rays of the model. Everything else
is Mitsuba's: intersections, offsets of spawned rays, emitter sampling and, for native materials,
BSDFs.

- If every surface is lit directly only, the image is the sum of `direct` with each light alone (of
  several, the integrator would choose one at random) and of the directly visible background (`path`
  of depth 1).
- If every surface only reflects or refracts, it is `path`, which follows one random branch per hit.

Other scenes have no stock integrator: `path` adds light between diffuse surfaces, and `direct`
follows no reflections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, List, Tuple

import numpy as np

from . import patterns, shapes
from .document import Document
from .driver import LANES, Rays, Tracer
from .errors import Unsupported
from .runtime import dr, mi
from .scene import Built, load_shapes
from .settings import Setting
from .textures import Constant

# Materials that are lit by the lights only, and those that only reflect or refract rays.
LIT = ("matte", "phong", "blinn_phong", "whitted")
SPECULAR = ("mirror", "conductor", "dielectric", "thin_dielectric")


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
        if any(max(material.interior + material.exterior) > 0 for material in materials):
            reasons.append("material: absorption in Mitsuba is a medium, which the driver does not build")
        if document.integrator.limit_background or document.integrator.min_contribution > 0:
            reasons.append("integrator: Mitsuba sees black beyond the last bounce, and cuts off no faint branches")
    if not document.integrator.shadows:
        reasons.append("integrator: Mitsuba always has shadows")
    elif document.integrator.filtered and any("T" in material.branches for material in materials):
        reasons.append("integrator: Mitsuba's shadows are opaque")
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
        reasons.append("light: the slide of a projector is looked up in Python, which Mitsuba's integrators cannot call")
    looks = [texture for material in materials for texture in material.textures.values()]
    if any(_is_python(texture) for texture in looks):
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


def _is_python(texture: Any) -> bool:
    """Whether the twin of a texture uses NumPy, which code that Dr.Jit records cannot."""
    if isinstance(texture, Constant):
        return False
    return isinstance(texture, patterns.HOSTED) or not texture.mapping.usual() or getattr(texture, "folded", False)


def _lies_by_uv(texture: Any) -> bool:
    if isinstance(texture, Constant):
        return False
    return texture.mapping.projection == "uv"


def _terms(built: Built) -> Tuple[str, List[Term]]:
    """The name of the integrator, and all terms."""
    document = built.document
    sky = [built.background] if max(document.lights.background) > 0 else []
    branches = any(document.materials[number].branches for number in document.used())
    if document.integrator.follow and branches:
        depth = document.integrator.max_depth + 1
        # No Russian roulette: it would only add noise.
        return "path", [Term({"type": "path", "max_depth": depth, "rr_depth": depth + 1}, sky)]
    terms = [Term({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}, [emitter]) for emitter in built.emitters]
    if sky:
        terms.append(Term({"type": "path", "max_depth": 1, "rr_depth": 2}, sky))
    return "direct", terms


def render(built: Built, setting: Setting, repeats: int) -> Image:
    """The image of a scene that passes `check`."""
    document = built.document
    name, terms = _terms(built)
    if name == "direct":
        # Nothing in it is random: lights are points, and each is sampled separately.
        repeats = min(repeats, 2)
    loaded = []
    for term in terms:
        extra = {f"zz_emitter{number}": emitter for number, emitter in enumerate(term.emitters)}
        loaded.append((mi.load_dict(term.integrator), load_shapes(document, built.bsdfs, setting, extra)[0]))
    tracer = Tracer(built, [setting])
    samples = len(document.samples)
    step = max(1, LANES // samples)
    count = document.width * document.height
    total, squares = np.zeros((count, 3)), np.zeros((count, 3))
    for first in range(0, count, step):
        pixels = np.arange(first, min(first + step, count))
        which = np.zeros(len(pixels), dtype=np.int64)
        rays = tracer.camera_rays(pixels % document.width, pixels // document.width, which, document.samples)
        for repeat in range(repeats):
            value = sum(_sample(integrator, scene, rays, repeat) for integrator, scene in loaded)
            value = np.reshape(value, (len(pixels), samples, 3)).mean(axis=1) if loaded else np.zeros((len(pixels), 3))
            total[pixels] += value
            squares[pixels] += value * value
    mean = total / repeats
    variance = np.maximum(squares - repeats * mean * mean, 0) / max(1, repeats - 1)
    # A variance that comes from rounding equal values is no noise.
    variance[variance < 1e-12 * mean * mean] = 0
    return Image(mean, variance, repeats, name)


def _sample(integrator: "mi.Integrator", scene: "mi.Scene", rays: Rays, seed: int) -> np.ndarray:
    """(n, 3) float64: `Integrator.sample` along each ray."""
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, dr.width(rays.o))
    ray = mi.RayDifferential3f(mi.Ray3f(rays.o, rays.d))
    value, _, _ = integrator.sample(scene, sampler, ray)
    value = mi.Color3f(value)
    return np.array(value, dtype=np.float64).reshape(3, -1).T[: rays.real]
