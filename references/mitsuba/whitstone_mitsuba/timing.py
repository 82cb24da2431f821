"""Run times after warm-up of the driver and of Mitsuba's C++ `path` on the same scene (op `time`).
"""

from __future__ import annotations

import statistics
import time
from typing import Any, Callable, Dict, Optional

import numpy as np

from .driver import Tracer
from .runtime import dr, mi
from .scene import Built, load_shapes
from .settings import Setting


def _median(repeats: int, run: Callable[[], Any]) -> float:
    """Median seconds of `run`, after one warm-up run (which compiles)."""
    seconds = []
    for number in range(repeats + 1):
        begin = time.perf_counter()
        run()
        dr.sync_thread()
        if number:
            seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def run(built: Built, setting: Setting, repeats: int, path_depth: Optional[int]) -> Dict[str, Any]:
    """The answer of op `time`."""
    built.native_only("time")
    document = built.document
    y, x = np.divmod(np.arange(document.width * document.height), document.width)
    which = np.zeros(len(x), dtype=np.int64)
    tracers = []

    def drive() -> None:
        tracers.append(Tracer(built, [setting]))
        tracers[-1].pixels(x, y, which)

    driver_s = _median(repeats, drive)
    counts = tracers[-1].counts
    emitters = {f"zz_emitter{number}": emitter for number, emitter in enumerate(built.emitters)}
    if max(document.lights.background) > 0:
        emitters["zz_background"] = built.background
    samples = len(document.samples)
    depth = document.integrator.max_depth + 1 if path_depth is None else path_depth
    sensor = document.camera.build(samples)
    scene, _ = load_shapes(document, built.bsdfs, setting, {**emitters, "zz_sensor": sensor})
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": depth + 1})
    path_s = _median(repeats, lambda: dr.eval(mi.render(scene, integrator=integrator, sensor=sensor, spp=samples)))
    return {
        "driver_s": driver_s,
        "driver_rays": {"closest": counts.closest, "shadow": counts.shadow},
        "path_s": path_s,
    }
