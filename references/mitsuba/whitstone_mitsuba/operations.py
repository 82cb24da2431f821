"""The operations of PROTOCOL.md: each maps a request to an answer, both plain dictionaries."""

from __future__ import annotations

import os
import platform
import time
from typing import Any, Dict, List

import numpy as np

from whitstone_protocol import exr, requests
from whitstone_protocol.errors import DriverError, Unsupported
from whitstone_protocol.requests import Answer, Operation, Request, cpu, get

from . import aovs, check, document, paths, probes, stock, timing, tree, usage
from .driver import Tracer
from .lanes import Counts
from .runtime import LLVM, VARIANT, dr, mi, set_threads
from .scene import Built, Cache, geometry
from .settings import Setting

_documents = Cache(16)
_scenes = Cache(8)


def _parse(request: Request, moment: int = 0) -> document.Document:
    """The request's document at one of its times; cached until its text or its files change."""
    key = (get(request, "scene", str), get(request, "base", str, "."), moment)
    parsed = _documents.get(key, lambda: document.parse(*key))
    if not parsed.folder.unchanged():
        _documents.forget(key)
        parsed = _documents.get(key, lambda: document.parse(*key))
    return parsed


def _load(request: Request, setting: Setting, moment: int = 0) -> Built:
    """The request's scene at one of its times; cached until it changes."""
    parsed = _parse(request, moment)
    if setting.vertices:
        # Used only once, and there may be many seeds: not cached.
        return Built(parsed, setting)
    # Keyed by identity: a document that is read again is a new key. (The entry keeps the document
    # alive, so ids are not reused.)
    return _scenes.get((id(parsed), setting.robust), lambda: Built(parsed, setting))


def _threads(request: Request) -> None:
    set_threads(get(request, "threads", int, 0))


def _all_pixels(built: Built) -> Any:
    y, x = np.divmod(np.arange(built.document.width * built.document.height), built.document.width)
    return x, y


def hello(request: Request) -> Answer:
    """Versions and the machine."""
    return {
        "mitsuba": mi.__version__,
        "drjit": dr.__version__,
        "variant": VARIANT,
        "python": platform.python_version(),
        "libllvm": os.path.basename(LLVM.path),
        "llvm_version": LLVM.version,
        "cpu": cpu(),
        "threads": dr.thread_count(),
    }


def render(request: Request) -> Answer:
    """Renders all pixels and writes the EXR."""
    setting = Setting.read(request.get("setting"))
    out = get(request, "out", str)
    _threads(request)
    memory = usage.Memory()
    processor, begin = time.process_time(), time.perf_counter()
    built = _load(request, setting)
    doc = built.document
    x, y = _all_pixels(built)
    loading, counts = time.perf_counter() - begin, Counts()
    means: Dict[str, Any] = {}
    coincident: List[dict] = []
    tracer = Tracer(built, [setting])
    for moment in range(doc.moments):
        if moment > 0:
            start = time.perf_counter()
            tracer = Tracer(_load(request, setting, moment), [setting])
            loading += time.perf_counter() - start
        values = tracer.pixels(x, y, np.zeros(len(x), dtype=np.int64))
        found = {letter: values[:, number] for number, letter in enumerate("RGB")}
        # The path classes do not count as time of the image.
        start, own = time.perf_counter(), time.process_time()
        if doc.paths:
            found.update(paths.render(tracer, x, y))
        begin, processor = begin + time.perf_counter() - start, processor + time.process_time() - own
        coincident.extend(pair for pair in tracer.built.document.coincident if pair not in coincident)
        for name, plane in found.items():
            means[name] = means.get(name, 0.0) + plane.astype(np.float64) / doc.moments
        counts.add(tracer.counts)
    traced = time.perf_counter()
    processor = time.process_time() - processor
    grown = memory.grown()
    channels = {letter: means.pop(letter) for letter in "RGB"}
    if doc.aovs:
        channels.update(aovs.render(Tracer(built, [setting]), x, y))
    channels.update(means)
    _write(out, doc, channels)
    return {
        "seconds": {"load": loading, "trace": traced - begin - loading, "cpu": processor},
        "memory": grown,
        "rays": {"closest": counts.closest, "shadow": counts.shadow},
        "width": doc.width,
        "height": doc.height,
        "samples": len(doc.samples) * doc.moments,
        "twin": doc.twin(),
        "hosted": doc.hosted(),
        "coincident": coincident,
        "respawned": counts.respawned,
        "rehits": counts.rehits,
        "setting": setting.to_json(),
    }


def stock_(request: Request) -> Answer:
    """Renders all pixels with Mitsuba's own integrators, including their noise, and writes the EXR.
    """
    setting = Setting.read(request.get("setting"))
    out = get(request, "out", str)
    repeats = get(request, "repeats", int, 16)
    if repeats < 2:
        raise DriverError(f"repeats: expected at least 2, found {repeats}")
    _threads(request)
    begin = time.perf_counter()
    stock.check(_parse(request))
    if _parse(request).moments > 1:
        raise Unsupported("film.time: Mitsuba's own integrators render one time")
    built = _load(request, setting)
    loaded = time.perf_counter()
    image = stock.render(built, setting, repeats)
    traced = time.perf_counter()
    doc = built.document
    channels = {letter: image.mean[:, number] for number, letter in enumerate("RGB")}
    channels.update({f"variance.{letter}": image.variance[:, number] for number, letter in enumerate("RGB")})
    channels["samples.N"] = np.full(len(image.mean), image.repeats)
    _write(out, doc, channels)
    # Its media replace the driver's formula.
    hosted = [entry for entry in doc.hosted() if image.integrator != "volpathmis" or entry["type"] != "absorption"]
    return {
        "seconds": {"load": loaded - begin, "trace": traced - loaded},
        "integrator": image.integrator,
        "repeats": image.repeats,
        "samples": len(doc.samples),
        "twin": document.twin_of(hosted),
        "hosted": hosted,
    }


def _write(out: str, doc: document.Document, channels: Dict[str, Any]) -> None:
    """Writes one number per pixel for each channel."""
    planes = {name: np.asarray(plane, dtype="<f4").tobytes() for name, plane in channels.items()}
    try:
        exr.write(out, doc.width, doc.height, planes)
    except OSError as error:
        raise DriverError(f"{out}: cannot be written: {error.strerror}") from error


def probe(request: Request) -> Answer:
    """Some pixels under some settings; all settings that share a geometry are traced together."""
    pixels = get(request, "pixels", list)
    settings = [Setting.read(value) for value in get(request, "settings", list, [None])]
    _threads(request)
    values: List[Any] = [None] * len(settings)
    groups: Dict[Any, List[int]] = {}
    for number, setting in enumerate(settings):
        groups.setdefault(geometry(setting), []).append(number)
    for mine in groups.values():
        built = _load(request, settings[mine[0]])
        xy = np.array([_pixel(pixel, built) for pixel in pixels], dtype=np.int64).reshape(-1, 2)
        which = np.repeat(np.arange(len(mine)), len(xy))
        radiance: Any = 0.0
        for moment in range(built.document.moments):
            tracer = Tracer(_load(request, settings[mine[0]], moment), [settings[number] for number in mine])
            values_there = tracer.pixels(np.tile(xy[:, 0], len(mine)), np.tile(xy[:, 1], len(mine)), which)
            radiance = radiance + values_there.astype(np.float64) / built.document.moments
        radiance = radiance.astype(np.float32)
        for number, rows in zip(mine, radiance.reshape(len(mine), len(xy), 3)):
            values[number] = rows.tolist()
    return {"values": values}


def _pixel(value: Any, built: Built) -> Any:
    doc = built.document
    good = isinstance(value, list) and len(value) == 2 and all(isinstance(n, int) and not isinstance(n, bool) for n in value)
    if not good or not (0 <= value[0] < doc.width and 0 <= value[1] < doc.height):
        raise DriverError(f"pixel: expected [x, y] inside the film of {doc.width} x {doc.height}, found {value!r}")
    return value


def tree_(request: Request) -> Answer:
    """The ray tree of one sample of one pixel."""
    setting = Setting.read(request.get("setting"))
    _threads(request)
    built = _load(request, setting)
    x, y = _pixel(request.get("pixel"), built)
    # The samples of one time are consecutive.
    moment, sample = divmod(get(request, "sample", int, 0), len(built.document.samples))
    if not 0 <= moment < built.document.moments:
        raise DriverError(f"sample: expected 0 to {len(built.document.samples) * built.document.moments - 1}")
    return {"nodes": tree.grow(_load(request, setting, moment), setting, x, y, sample)}


def check_(request: Request) -> Answer:
    """Compares the driver with Mitsuba's own integrators."""
    setting = Setting.read(request.get("setting"))
    _threads(request)
    return check.run(_load(request, setting), setting)


def time_(request: Request) -> Answer:
    """Run times after warm-up."""
    setting = Setting.read(request.get("setting"))
    _threads(request)
    repeats = get(request, "repeats", int, 3)
    if repeats < 1:
        raise DriverError(f"repeats: expected at least 1, found {repeats}")
    depth = None if request.get("path_depth") is None else get(request, "path_depth", int)
    return timing.run(_load(request, setting), setting, repeats, depth)


def closest(request: Request) -> Answer:
    """Mitsuba's nearest hits of single rays."""
    _threads(request)
    distances, nanoseconds = probes.closest(_load(request, Setting.read(request.get("setting"))), get(request, "rays", list))
    return {"t": distances, "ns_per_ray": nanoseconds}


def occluded(request: Request) -> Answer:
    """Mitsuba's shadow rays."""
    built = _load(request, Setting.read(request.get("setting")))
    return {"blocked": probes.occluded(built, get(request, "rays", list), get(request, "target", list))}


def walk(request: Request) -> Answer:
    """Numbers of surfaces along Mitsuba's successively spawned rays."""
    built = _load(request, Setting.read(request.get("setting")))
    return {"counts": probes.walk(built, get(request, "rays", list), get(request, "mode", str), get(request, "limit", int))}


def fresnel(request: Request) -> Answer:
    """Mitsuba's Fresnel term."""
    reflectances, transmitted = probes.fresnel(get(request, "cosines", list), get(request, "ior", float))
    return {"reflectance": reflectances, "cosine": transmitted}


def camera(request: Request) -> Answer:
    """Mitsuba's camera rays."""
    built = _load(request, Setting.read(request.get("setting")))
    return {"directions": probes.camera(built, get(request, "positions", list))}


OPERATIONS: Dict[str, Operation] = {
    "hello": hello,
    "render": render,
    "stock": stock_,
    "probe": probe,
    "tree": tree_,
    "check": check_,
    "time": time_,
    "closest": closest,
    "occluded": occluded,
    "walk": walk,
    "fresnel": fresnel,
    "camera": camera,
}


def answer(request: Any) -> Answer:
    """Executes one request; never raises."""
    return requests.answer("whitstone_mitsuba", OPERATIONS, request)
