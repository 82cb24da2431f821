"""The operations of PROTOCOL.md that POV-Ray supports: each maps a request to an answer, both plain
dictionaries.
"""

from __future__ import annotations

import os
import platform
import struct
import time
from typing import Any, Dict, List

from whitstone_protocol import exr, requests
from whitstone_protocol.errors import DriverError
from whitstone_protocol.requests import Answer, Operation, Request, cpu, get

from . import povray, tracing
from .halves import Color
from .settings import Setting


def _scene(request: Request) -> tracing.Scene:
    return tracing.Scene(get(request, "scene", str), get(request, "base", str, "."))


def hello(request: Request) -> Answer:
    """Versions and the machine."""
    return {"povray": povray.version(), "python": platform.python_version(), "cpu": cpu(), "threads": os.cpu_count() or 1}


def render(request: Request) -> Answer:
    """Renders all pixels and writes the EXR. POV-Ray's ray counts are not reported, because it runs
    several times.
    """
    setting = Setting.read(request.get("setting"))
    out = get(request, "out", str)
    begin = time.perf_counter()
    rows, document = tracing.render(_scene(request), setting)
    seconds = time.perf_counter() - begin
    try:
        exr.write(out, document.width, document.height, _channels(rows))
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


def _channels(rows: List[List[Color]]) -> Dict[str, bytes]:
    """The colours as the channels of an EXR file."""
    planes = zip(*(color for row in rows for color in row))
    return {letter: struct.pack(f"<{len(plane)}f", *plane) for letter, plane in zip("RGB", planes)}


def probe(request: Request) -> Answer:
    """Some pixels under some settings. POV-Ray renders rectangles, so it renders the bounding
    rectangle of the pixels.
    """
    pixels = get(request, "pixels", list)
    settings = [Setting.read(value) for value in get(request, "settings", list, [None])]
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


OPERATIONS: Dict[str, Operation] = {"hello": hello, "render": render, "probe": probe, "write": write}


def answer(request: Any) -> Answer:
    """Executes one request; never raises."""
    return requests.answer("whitstone_povray", OPERATIONS, request)
