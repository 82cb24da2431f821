"""The ray tree of one sample, node by node (op `tree`)."""

from __future__ import annotations

from typing import Any, Dict, List, Optional

import numpy as np

from whitstone_protocol.errors import DriverError

from .driver import Tracer
from .levels import Level
from .scene import Built
from .settings import Setting


def _color(array: Any, lane: int) -> List[float]:
    return [array[channel][lane] for channel in range(len(array))]


def _find(lanes: np.ndarray, lane: int) -> Optional[int]:
    place = np.flatnonzero(lanes == lane)
    return int(place[0]) if len(place) else None


def _lights(tracer: Tracer, level: Level, lane: int) -> List[Dict[str, Any]]:
    """Contributions of the lights to the local term, by their number in the document (backgrounds
    are not lights here).
    """
    found: List[Dict[str, Any]] = []
    for lanes, index, visible, value in level.lamps:
        place = _find(lanes, lane)
        if place is not None:
            found.append({"index": index, "visible": bool(visible[place]), "value": _color(value, place)})
    total = np.array(tracer.document.lights.ambient)
    for lanes, value in level.ambient:
        place = _find(lanes, lane)
        if place is None:
            continue
        ambient = np.array(_color(value, place))
        for index, radiance in tracer.document.lights.ambients:
            share = np.divide(radiance, total, out=np.zeros(3), where=total > 0)
            found.append({"index": index, "visible": True, "value": list(ambient * share)})
    return sorted(found, key=lambda entry: entry["index"])


def grow(built: Built, setting: Setting, x: int, y: int, sample: int) -> List[Dict[str, Any]]:
    """All nodes in depth-first order; the sum of throughput * local over them is the sample's
    value.
    """
    document = built.document
    if not (0 <= x < document.width and 0 <= y < document.height):
        raise DriverError(f"pixel: [{x}, {y}] is outside the film of {document.width} x {document.height}")
    if not 0 <= sample < len(document.samples):
        raise DriverError(f"sample: expected 0 to {len(document.samples) - 1}, found {sample}")
    tracer = Tracer(built, [setting], record=True)
    one = np.array([0])
    rays = tracer.camera_rays(np.array([x]), np.array([y]), one, document.samples.only(sample))
    tracer.trace(rays, 0)
    nodes: List[Dict[str, Any]] = []
    # An explicit stack, since a path can be longer than Python's recursion limit. Entries are
    # (depth, lane, path) or a finished leaf.
    stack: List[Any] = [(0, 0, "")]
    while stack:
        top = stack.pop()
        if isinstance(top, dict):
            nodes.append(top)
            continue
        depth, lane, path = top
        level = tracer.levels[depth]
        hits = level.hits
        valid = bool(hits.valid[lane])
        nodes.append(
            {
                "path": path,
                "shape": int(tracer.built.numbers[int(hits.shape[lane])]) if valid else -1,
                "primitive": int(hits.primitive[lane]) if valid else -1,
                "t": hits.t[lane],
                "p": _color(hits.p, lane) if valid else [0.0] * 3,
                "n_g": _color(hits.n_g, lane) if valid else [0.0] * 3,
                "n_s": _color(hits.n_s, lane) if valid else [0.0] * 3,
                "uv": _color(hits.uv, lane) if valid else [0.0] * 2,
                "throughput": _color(hits.throughput, lane),
                "local": _color(hits.local, lane),
                "lights": _lights(tracer, level, lane),
            }
        )
        following: List[Any] = []
        for letter, parents, weight, children, limit in level.links:
            place = _find(parents, lane)
            if place is None:
                continue
            if children is not None:
                following.append((depth + 1, int(children[place]), path + letter))
            else:
                throughput = np.array(_color(hits.throughput, lane)) * np.array(_color(weight, place))
                leaf = {"path": path + letter, "shape": -1, "primitive": -1, "t": float("inf"), "p": [0.0] * 3, "n_g": [0.0] * 3}
                leaf.update(n_s=[0.0] * 3, uv=[0.0] * 2, throughput=list(throughput), local=_color(limit, place), lights=[])
                following.append({**leaf, "limit": True})
        stack.extend(reversed(following))
    return nodes
