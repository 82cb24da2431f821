"""Compares the driver with Mitsuba's own C++ integrators on the driver's camera rays (op `check`).

`direct` integrates direct light by emitter sampling. This is exact for delta emitters, so it must
agree with the driver's local terms (without the ambient term). `path` follows one branch per hit.
It is exact as well if every hit has only one branch (mirrors).
"""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any, Dict, List, Tuple

import numpy as np

from .driver import LANES, Tracer
from .levels import Rays
from .runtime import dr, mi
from .samplers import CENTRE, Samples
from .scene import Built, load_shapes
from .settings import Setting
from .stock import is_python

_CENTRE = Samples.all(CENTRE)


def run(built: Built, setting: Setting) -> Dict[str, Any]:
    """The answer of op `check`."""
    why: Dict[str, str] = {}
    answer: Dict[str, Any] = {}
    for name, compare in (("direct", _direct), ("path", _path)):
        try:
            answer[name] = compare(built, setting)
        except NotApplicable as reason:
            answer[name], why[name] = None, str(reason)
    return {**answer, "why": why}


class NotApplicable(Exception):
    """Raised by an integrator that does not apply to a scene; the text gives the reason."""


def _native_only(built: Built) -> None:
    if built.host is not None:
        raise NotApplicable("Mitsuba's scene lacks the hosted shapes, which the driver intersects")


def _native_textures(document: Any) -> None:
    textures = [texture for number in document.used() for texture in document.materials[number].textures.values()]
    if any(map(is_python, textures)):
        raise NotApplicable("a texture is computed in Python, which Mitsuba's integrators cannot call")


def _compare(ours: np.ndarray, theirs: np.ndarray) -> Dict[str, Any]:
    """Largest difference over RGB, relative to |theirs| + a tenth of their mean: 1e-3 is the
    harness's pixel tolerance.
    """
    difference = np.abs(ours.astype(np.float64) - theirs)
    relative = difference / (np.abs(theirs) + 0.1 * np.abs(theirs).mean() + 1e-30)
    worst = relative.max(axis=1)
    return {
        "pixels": len(worst),
        "median_rel": float(np.median(worst)),
        "max_rel": float(worst.max()),
        "over_1e3": int((worst > 1e-3).sum()),
    }


def _pixels(built: Built) -> Tuple[np.ndarray, np.ndarray]:
    """All pixels, or an even subset of them if the image is large."""
    count = built.document.width * built.document.height
    chosen = np.arange(0, count, max(1, -(-count // LANES)))
    return chosen % built.document.width, chosen // built.document.width


def _sample(integrator: dict, scene: Any, rays: Rays) -> np.ndarray:
    """(n, 3): `Integrator.sample` on the driver's rays."""
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, dr.width(rays.o))
    ray = mi.RayDifferential3f(mi.Ray3f(rays.o, rays.d))
    value, _, _ = mi.load_dict(integrator).sample(scene, sampler, ray)
    return mi.Color3f(value).numpy().T[: rays.real]


def _direct(built: Built, setting: Setting) -> Dict[str, Any]:
    document = built.document
    _native_only(built)
    _native_textures(document)
    used = document.used()
    if any(document.materials[number].parts or document.materials[number].type == "emissive" for number in used):
        raise NotApplicable("only the driver evaluates composite and emissive materials")
    if any(built.shaders[number].passes(document.integrator.filtered) for number in used) or not built.casts_shadow.all():
        raise NotApplicable("Mitsuba's shadow rays are blocked by every surface; some surfaces of this scene let them pass")
    if not any(document.materials[number].smooth for number in used):
        raise NotApplicable("no surface has a local term")
    if not document.lights.lamps:
        raise NotApplicable("no light has a direction: the scene has ambient light or a background only")
    if not document.integrator.shadows:
        raise NotApplicable('`shadows = "none"`: Mitsuba always traces shadow rays')
    bare = copy.copy(built)
    bare.document = replace(document, integrator=replace(document.integrator, follow=False, light_cutoff=0.0))
    bare.ambient_light = mi.Color3f(dr.opaque(mi.Float, 0.0))
    tracer = Tracer(bare, [setting])
    tracer.native_uv = True  # Mitsuba's integrators do not know the model's uv
    x, y = _pixels(built)
    rays = tracer.camera_rays(x, y, np.zeros(len(x), dtype=np.int64), _CENTRE)
    level, _ = tracer.level(rays, 0)
    smooth = np.array([material.smooth for material in document.materials] + [False])
    material = level.hits.material.numpy()[: rays.real]
    lit = smooth[np.minimum(material, len(document.materials))]
    if not lit.any():
        raise NotApplicable("no pixel shows a surface with a local term")
    theirs = np.zeros((rays.real, 3), dtype=np.float32)  # summed in the driver's order
    # One emitter at a time: of several, the integrator would choose one at random.
    for emitter in built.emitters:
        scene, _ = load_shapes(document, built.bsdfs, setting, {"zz_emitter": emitter})
        theirs += _sample({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}, scene, rays)
    return _compare(level.hits.local.numpy().T[: rays.real][lit], theirs[lit])


def _path(built: Built, setting: Setting) -> Dict[str, Any]:
    document = built.document
    _native_only(built)
    _native_textures(document)
    kinds = {document.materials[shape.material].type for shape in document.shapes}
    others: List[str] = sorted(kinds - {"mirror"})
    if others:
        raise NotApplicable(
            f"`path` follows one branch per hit and adds indirect light, so it agrees on mirrors only; this scene has {', '.join(others)}"
        )
    if not kinds:
        raise NotApplicable("the scene has no surfaces")
    if not document.integrator.follow:
        raise NotApplicable("the integrator traces no specular rays")
    if document.lights.environments:
        raise NotApplicable("only the driver evaluates environments")
    if max(document.lights.background) == 0:
        raise NotApplicable("the scene has no background for the mirrors to reflect")
    bare = copy.copy(built)
    # Mitsuba returns black beyond the last bounce, and has no contribution threshold.
    bare.document = replace(document, integrator=replace(document.integrator, limit_background=False, min_contribution=0.0))
    tracer = Tracer(bare, [setting])
    tracer.native_uv = True
    x, y = _pixels(built)
    rays = tracer.camera_rays(x, y, np.zeros(len(x), dtype=np.int64), _CENTRE)
    ours = tracer.trace(rays, 0).numpy().T[: rays.real]
    bounces = document.integrator.max_depth
    scene, _ = load_shapes(document, built.bsdfs, setting, {"zz_emitter": built.background})
    theirs = _sample({"type": "path", "max_depth": bounces + 1, "rr_depth": bounces + 2}, scene, rays)
    return _compare(ours, theirs)
