"""The operations of PROTOCOL.md: each maps a request to an answer, both plain dictionaries."""

from __future__ import annotations

import math
import os
import platform
import sys
import time
from typing import Any, Callable, Dict, List

import numpy as np

from . import aovs, check, document, exr, probes, stock, timing, tree, usage
from .driver import Tracer
from .errors import DriverError
from .runtime import LLVM, VARIANT, dr, mi, set_threads
from .scene import Built, Cache, geometry
from .settings import Setting

Request = Dict[str, Any]
Answer = Dict[str, Any]

_documents = Cache(16)
_scenes = Cache(8)


def _get(request: Request, key: str, kind: type, default: Any = None) -> Any:
    """A key of the request, with the required type; mandatory if there is no default."""
    value = request.get(key, default)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise DriverError(f"{key}: expected {kind.__name__}, found {value!r}")
    return value


def _parse(request: Request) -> document.Document:
    """The request's document; cached until its text or its files change."""
    key = (_get(request, "scene", str), _get(request, "base", str, "."))
    parsed = _documents.get(key, lambda: document.parse(*key))
    if not parsed.folder.unchanged():
        _documents.forget(key)
        parsed = _documents.get(key, lambda: document.parse(*key))
    return parsed


def _load(request: Request, setting: Setting) -> Built:
    """The request's scene; cached until it changes."""
    parsed = _parse(request)
    if setting.vertices:
        # Used only once, and there may be many seeds: not cached.
        return Built(parsed, setting)
    # Keyed by identity: a document that is read again is a new key. (The entry keeps the document
    # alive, so ids are not reused.)
    return _scenes.get((id(parsed), setting.robust), lambda: Built(parsed, setting))


def _threads(request: Request) -> None:
    set_threads(_get(request, "threads", int, 0))


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
        "cpu": _cpu(),
        "threads": dr.thread_count(),
    }


def _cpu() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def render(request: Request) -> Answer:
    """Renders all pixels and writes the EXR."""
    setting = Setting.read(request.get("setting"))
    out = _get(request, "out", str)
    _threads(request)
    memory = usage.Memory()
    processor, begin = time.process_time(), time.perf_counter()
    built = _load(request, setting)
    loaded = time.perf_counter()
    doc = built.document
    x, y = _all_pixels(built)
    tracer = Tracer(built, [setting])
    values = tracer.pixels(x, y, np.zeros(len(x), dtype=np.int64))
    traced = time.perf_counter()
    processor = time.process_time() - processor
    grown = memory.grown()
    channels = {letter: values[:, number] for number, letter in enumerate("RGB")}
    if doc.aovs:
        channels.update(aovs.render(Tracer(built, [setting]), x, y))
    _write(out, {name: plane.reshape(doc.height, doc.width) for name, plane in channels.items()})
    return {
        "seconds": {"load": loaded - begin, "trace": traced - loaded, "cpu": processor},
        "memory": grown,
        "rays": {"closest": tracer.counts.closest, "shadow": tracer.counts.shadow},
        "width": doc.width,
        "height": doc.height,
        "samples": len(doc.samples),
        "twin": doc.twin(),
        "hosted": doc.hosted(),
        "coincident": list(doc.coincident),
        "respawned": tracer.counts.respawned,
        "rehits": tracer.counts.rehits,
        "setting": setting.to_json(),
    }


def stock_(request: Request) -> Answer:
    """Renders all pixels with Mitsuba's own integrators, including their noise, and writes the EXR.
    """
    setting = Setting.read(request.get("setting"))
    out = _get(request, "out", str)
    repeats = _get(request, "repeats", int, 16)
    if repeats < 2:
        raise DriverError(f"repeats: expected at least 2, found {repeats}")
    _threads(request)
    begin = time.perf_counter()
    stock.check(_parse(request))
    built = _load(request, setting)
    loaded = time.perf_counter()
    image = stock.render(built, setting, repeats)
    traced = time.perf_counter()
    doc = built.document
    channels = {letter: image.mean[:, number] for number, letter in enumerate("RGB")}
    channels.update({f"variance.{letter}": image.variance[:, number] for number, letter in enumerate("RGB")})
    channels["samples.N"] = np.full(len(image.mean), image.repeats)
    _write(out, {name: plane.reshape(doc.height, doc.width) for name, plane in channels.items()})
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


def _write(out: str, channels: Dict[str, Any]) -> None:
    try:
        exr.write(out, channels)
    except OSError as error:
        raise DriverError(f"{out}: cannot be written: {error.strerror}") from error


def probe(request: Request) -> Answer:
    """Some pixels under some settings; all settings that share a geometry are traced together."""
    pixels = _get(request, "pixels", list)
    settings = [Setting.read(value) for value in _get(request, "settings", list, [None])]
    _threads(request)
    values: List[Any] = [None] * len(settings)
    groups: Dict[Any, List[int]] = {}
    for number, setting in enumerate(settings):
        groups.setdefault(geometry(setting), []).append(number)
    for mine in groups.values():
        built = _load(request, settings[mine[0]])
        xy = np.array([_pixel(pixel, built) for pixel in pixels], dtype=np.int64).reshape(-1, 2)
        tracer = Tracer(built, [settings[number] for number in mine])
        which = np.repeat(np.arange(len(mine)), len(xy))
        radiance = tracer.pixels(np.tile(xy[:, 0], len(mine)), np.tile(xy[:, 1], len(mine)), which)
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
    return {"nodes": tree.grow(built, setting, x, y, _get(request, "sample", int, 0))}


def check_(request: Request) -> Answer:
    """Compares the driver with Mitsuba's own integrators."""
    setting = Setting.read(request.get("setting"))
    _threads(request)
    return check.run(_load(request, setting), setting)


def time_(request: Request) -> Answer:
    """Run times after warm-up."""
    setting = Setting.read(request.get("setting"))
    _threads(request)
    repeats = _get(request, "repeats", int, 3)
    if repeats < 1:
        raise DriverError(f"repeats: expected at least 1, found {repeats}")
    depth = None if request.get("path_depth") is None else _get(request, "path_depth", int)
    return timing.run(_load(request, setting), setting, repeats, depth)


def closest(request: Request) -> Answer:
    """Mitsuba's nearest hits of single rays."""
    _threads(request)
    distances, nanoseconds = probes.closest(_load(request, Setting.read(request.get("setting"))), _get(request, "rays", list))
    return {"t": distances, "ns_per_ray": nanoseconds}


def occluded(request: Request) -> Answer:
    """Mitsuba's shadow rays."""
    built = _load(request, Setting.read(request.get("setting")))
    return {"blocked": probes.occluded(built, _get(request, "rays", list), _get(request, "target", list))}


def walk(request: Request) -> Answer:
    """Numbers of surfaces along Mitsuba's successively spawned rays."""
    built = _load(request, Setting.read(request.get("setting")))
    return {"counts": probes.walk(built, _get(request, "rays", list), _get(request, "mode", str), _get(request, "limit", int))}


def fresnel(request: Request) -> Answer:
    """Mitsuba's Fresnel term."""
    reflectances, transmitted = probes.fresnel(_get(request, "cosines", list), _get(request, "ior", float))
    return {"reflectance": reflectances, "cosine": transmitted}


def camera(request: Request) -> Answer:
    """Mitsuba's camera rays."""
    built = _load(request, Setting.read(request.get("setting")))
    return {"directions": probes.camera(built, _get(request, "positions", list))}


OPERATIONS: Dict[str, Callable[[Request], Answer]] = {
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


def plain(value: Any) -> Any:
    """Converts the answer for JSON: numpy numbers to Python's, non-finite numbers to strings."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, (bool, str, int)) or value is None:
        return value
    number = float(value)
    if math.isfinite(number):
        return number
    return "nan" if math.isnan(number) else ("inf" if number > 0 else "-inf")


def answer(request: Any) -> Answer:
    """Executes one request; never raises."""
    try:
        if not isinstance(request, dict):
            raise DriverError(f"expected a JSON object, found {type(request).__name__}")
        operation = OPERATIONS.get(request.get("op", ""))
        if operation is None:
            raise DriverError(f"unknown op {request.get('op')!r}; known: {', '.join(OPERATIONS)}")
        return {"ok": True, **plain(operation(request))}
    except DriverError as error:
        return {"ok": False, "kind": error.kind, "error": str(error)}
    except Exception as error:  # the process must survive whatever Mitsuba raises
        print(f"whitstone_mitsuba: {type(error).__name__}: {error}", file=sys.stderr)
        return {"ok": False, "kind": "internal", "error": f"{type(error).__name__}: {error}"}
