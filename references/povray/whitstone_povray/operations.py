"""The operations of PROTOCOL.md that POV-Ray supports: each maps a request to an answer, both plain
dictionaries.
"""

from __future__ import annotations

import math
import os
import platform
import sys
import time
from typing import Any, Callable, Dict, List

from . import exr, povray, tracing
from .errors import DriverError
from .settings import Setting

Request = Dict[str, Any]
Answer = Dict[str, Any]


def _get(request: Request, key: str, kind: type, default: Any = None) -> Any:
    value = request.get(key, default)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise DriverError(f"{key}: expected {kind.__name__}, found {value!r}")
    return value


def _scene(request: Request) -> tracing.Scene:
    return tracing.Scene(_get(request, "scene", str), _get(request, "base", str, "."))


def hello(request: Request) -> Answer:
    """Versions and the machine."""
    return {"povray": povray.version(), "python": platform.python_version(), "cpu": _cpu(), "threads": os.cpu_count() or 1}


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
    """Renders all pixels and writes the EXR. POV-Ray's ray counts are not reported, because it runs
    several times.
    """
    setting = Setting.read(request.get("setting"))
    out = _get(request, "out", str)
    begin = time.perf_counter()
    rows, document = tracing.render(_scene(request), setting)
    seconds = time.perf_counter() - begin
    try:
        exr.write(out, rows)
    except OSError as error:
        raise DriverError(f"{out}: cannot be written: {error.strerror}") from error
    return {
        "seconds": {"load": 0.0, "trace": seconds},
        "rays": {"closest": 0, "shadow": 0},
        "width": document.width,
        "height": document.height,
        "samples": len(document.samples),
        "twin": "formula" if document.formulas else "native",
        "hosted": [{"type": kind, "twin": "formula", "reason": reason} for kind, reason in document.formulas],
        "coincident": document.coincident,
        "rehits": 0,
        "setting": setting.to_json(),
    }


def probe(request: Request) -> Answer:
    """Some pixels under some settings. POV-Ray renders rectangles, so it renders the bounding
    rectangle of the pixels.
    """
    pixels = _get(request, "pixels", list)
    settings = [Setting.read(value) for value in _get(request, "settings", list, [None])]
    if not pixels or not settings:
        return {"values": [[] for _ in settings]}
    scene = _scene(request)
    document = tracing.documents(scene, settings[0])[0]
    for pixel in pixels:
        good = isinstance(pixel, list) and len(pixel) == 2 and all(isinstance(n, int) for n in pixel)
        if not good or not (0 <= pixel[0] < document.width and 0 <= pixel[1] < document.height):
            raise DriverError(f"pixel: expected [x, y] inside the film, found {pixel!r}")
    xs, ys = [pixel[0] for pixel in pixels], [pixel[1] for pixel in pixels]
    window = (min(xs), min(ys), max(xs) + 1, max(ys) + 1)
    found = tracing.images(scene, settings, 1, window)
    return {"values": [[list(image[y - window[1]][x - window[0]]) for x, y in pixels] for image in found]}


def write(request: Request) -> Answer:
    """The scene in POV-Ray's language for the first sample: one text per separately rendered
    channel, or one for all.
    """
    setting = Setting.read(request.get("setting"))
    found = tracing.documents(_scene(request), setting)
    return {"scenes": [document.write(document.samples[0]) for document in found]}


OPERATIONS: Dict[str, Callable[[Request], Answer]] = {"hello": hello, "render": render, "probe": probe, "write": write}


def plain(value: Any) -> Any:
    """Converts the answer for JSON: non-finite numbers to strings."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    return value


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
    except Exception as error:  # the process must survive any error
        print(f"whitstone_povray: {type(error).__name__}: {error}", file=sys.stderr)
        return {"ok": False, "kind": "internal", "error": f"{type(error).__name__}: {error}"}
