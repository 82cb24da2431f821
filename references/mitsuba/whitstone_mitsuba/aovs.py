"""AOVs: properties of the first surface behind each pixel's centre (model §11)."""

from __future__ import annotations

from typing import Dict

import numpy as np

from .driver import LANES, Tracer
from .samplers import CENTRE, Samples


def render(tracer: Tracer, x: np.ndarray, y: np.ndarray) -> Dict[str, np.ndarray]:
    """EXR channels, each (n,) float32, for the AOVs that the film requests."""
    wanted = tracer.document.aovs
    parts: Dict[str, list] = {}
    for first in range(0, len(x), LANES):
        span = slice(first, first + LANES)
        count = len(x[span])
        camera = tracer.document.camera
        near = camera.starts(camera.formula(x[span] + 0.5, y[span] + 0.5)[1])
        hits = tracer.intersect(tracer.camera_rays(x[span], y[span], np.zeros(count, dtype=np.int64), Samples.all(CENTRE)))
        valid = hits.valid.numpy()[:count]

        def add(name: str, values: np.ndarray, nothing: float = 0.0, valid: np.ndarray = valid) -> None:
            shown = np.where(valid, values[: len(valid)].astype(np.float32), np.float32(nothing))
            parts.setdefault(name, []).append(shown.astype(np.float32))

        if "depth" in wanted:
            add("depth.Z", hits.t.numpy()[:count] + near)
        if "normal" in wanted:
            for axis, letter in enumerate("XYZ"):
                add(f"normal.{letter}", hits.n_raw[axis].numpy())
        if "uv" in wanted:
            add("uv.U", hits.uv.x.numpy())
            add("uv.V", hits.uv.y.numpy())
        if "shape_id" in wanted:
            place = np.minimum(hits.shape.numpy(), len(tracer.built.numbers) - 1)
            add("shape_id.I", tracer.built.numbers[place], -1.0)
        if "primitive_id" in wanted:
            add("primitive_id.I", hits.primitive.numpy(), -1.0)
    return {name: np.concatenate(values) for name, values in parts.items()}
