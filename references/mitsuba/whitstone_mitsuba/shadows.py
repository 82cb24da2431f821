"""Shadow rays that surfaces attenuate instead of blocking (model §7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Sequence

import numpy as np

from .lanes import mix, pad
from .levels import Level, Rays
from .runtime import ULP, dr, mi

# Less than this in every channel counts as blocked.
CUT = 0.002

# In the place of the number of a material: that of a shape that casts no shadow.
NO_MATERIAL = -1

# A shadow ray that has crossed this many surfaces counts as blocked.
MOST_CROSSINGS = 1000

# The rays of several lamps are traced together up to this number of lanes.
MOST_LANES = 1 << 20

# Shadow rays end before a lamp by this relative margin: rounding must not put a surface at the lamp
# in front of it.
BEFORE_LAMP = 1 - 4 * ULP


def end_before(lamp: Any, reach: Any) -> Any:
    """The length of shadow rays to a lamp at this distance."""
    end = reach * BEFORE_LAMP
    return end - dr.opaque(mi.Float, lamp.margin) if lamp.margin > 0 else end


@dataclass
class Bundle:
    """Shadow rays from some lanes towards one lamp; one entry per lane."""

    number: int
    """The lamp."""
    p: Any
    n_g: Any
    l: Any  # noqa: E741 (the model's name)
    goal: Any
    """The point that the rays end at; None for a lamp at infinity."""
    counts: Any
    """Whether the lamp may light the lane."""


def through(tracer: Any, level: Any, lanes: Any, bundles: Sequence[Bundle]) -> List[Any]:
    """The share of each lamp's light that arrives (Color3f). `lanes` are indices in the level."""
    most = max(1, MOST_LANES // dr.width(lanes))
    shares: List[Any] = []
    for first in range(0, len(bundles), most):
        shares.extend(_together(tracer, level, lanes, bundles[first : first + most]))
    return shares


def _together(tracer: Any, level: Any, lanes: Any, bundles: Sequence[Bundle]) -> List[Any]:
    """`through`, with the rays of all lamps in the same arrays: a call of the library costs more
    than the few rays of a small image.
    """
    filtered = tracer.document.integrator.filtered
    rays = level.rays
    width = dr.width(lanes)
    share = dr.zeros(mi.Color3f, width * len(bundles))
    dr.make_opaque(share)
    dr.eval([(bundle.p, bundle.n_g, bundle.l, bundle.goal, bundle.counts) for bundle in bundles])
    picked = [np.flatnonzero(np.broadcast_to(bundle.counts.numpy(), width)) for bundle in bundles]
    # The indices of these rays in `share`.
    home = np.concatenate([chosen + k * width for k, chosen in enumerate(picked)])
    real = np.arange(len(home))
    if len(home) == 0:
        return _parts(share, width, len(bundles))

    def join(values: Sequence[Any]) -> Any:
        # Values that are the same in all lanes may have one entry.
        rows = [[np.broadcast_to(row.numpy(), width)[chosen] for row in value] for value, chosen in zip(values, picked)]
        return type(values[0])(np.concatenate(rows, axis=1))

    def spread(values: Sequence[Any], kind: Any) -> Any:
        return np.repeat(np.array(values, dtype=kind), [len(chosen) for chosen in picked])

    lamps = [tracer.document.lights.lamps[bundle.number] for bundle in bundles]
    p, n_g = join([mi.Point3f(bundle.p) for bundle in bundles]), join([mi.Vector3f(bundle.n_g) for bundle in bundles])
    l = join([mi.Vector3f(bundle.l) for bundle in bundles])  # noqa: E741
    target = join([mi.Point3f(bundle.p if bundle.goal is None else bundle.goal) for bundle in bundles])
    finite = mi.Bool(spread([bundle.goal is not None for bundle in bundles], bool))
    margin = mi.Float(spread([lamp.margin for lamp in lamps], np.float32))
    salt = mi.UInt32(spread([0x80000000 + bundle.number for bundle in bundles], np.uint32))
    here = mi.UInt32(np.ascontiguousarray(np.concatenate([lanes.numpy()[chosen] for chosen in picked]), dtype=np.uint32))
    setting = dr.gather(mi.UInt32, rays.setting, here)
    key = dr.gather(mi.UInt32, rays.key, here)
    path = mix(dr.gather(mi.UInt32, rays.path, here) + salt)
    medium = dr.gather(mi.Color3f, rays.medium, here) if filtered else dr.zeros(mi.Color3f, len(home))
    inside = dr.gather(mi.UInt64, rays.inside, here)
    shape, facet = dr.gather(mi.UInt32, level.hits.shape, here), dr.gather(mi.UInt32, level.hits.facet, here)
    left = mi.Color3f(dr.full(mi.Float, 1, len(home)))
    state = [p, n_g, shape, facet, l, target, setting, key, path, medium, left, inside, finite, margin]
    for crossing in range(MOST_CROSSINGS):
        if len(real) == 0:
            break
        chosen = pad(real)
        state = [dr.gather(type(array), array, chosen) for array in state]
        p, n_g, shape, facet, l, target, setting, key, path, medium, left, inside, finite, margin = state  # noqa: E741
        start = tracer.leave(p, n_g, l, shape, facet, setting)
        o = start.o
        towards = target - o
        distance = dr.norm(towards)
        d = dr.select(finite, towards / distance, l)
        reach = dr.select(finite, distance * BEFORE_LAMP - margin, dr.inf)
        path = mix(path + dr.opaque(mi.UInt32, crossing))
        o, d = tracer._perturb(o, d, key, path, setting)
        ray = Rays(
            o, d, mi.Color3f(left), mi.Color3f(medium), key, path, setting,
            start.shape, start.facet, start.within, start.push, mi.UInt64(inside), real=len(real),
        )  # fmt: skip
        for array in ray.arrays():
            dr.make_opaque(array)
        tracer.counts.shadow += len(real)
        hits = tracer.intersect(ray)
        blocked = hits.valid & (hits.t < reach)
        # The last segment, which ends at the lamp.
        last = dr.select(medium == 0, mi.Color3f(1), dr.exp(-medium * reach))
        arrived = dr.select(blocked, mi.Color3f(0), left * last)
        dr.eval(arrived, blocked)
        place = mi.UInt32(np.ascontiguousarray(home[: len(real)], dtype=np.uint32))
        if len(real) == 1:
            place = pad(home[:1])
        dr.scatter(share, arrived, place)
        dr.eval(share)
        stopped = np.flatnonzero(blocked.numpy()[: len(real)])
        if len(stopped) == 0:
            break
        # Transmittance of the surfaces, by material. Shapes that cast no shadow have none.
        kept = dr.zeros(mi.Color3f, dr.width(o))
        behind = mi.Color3f(medium)
        entered = mi.UInt64(inside)
        for array in (kept, behind, entered):
            dr.make_opaque(array)
        numbers = hits.material.numpy()[stopped].astype(np.int64)
        numbers[~tracer.built.casts_shadow[hits.shape.numpy()[stopped]]] = NO_MATERIAL
        stage = Level(ray, hits, hits.local, hits.transmittance)
        for material in np.unique(numbers):
            some = pad(stopped[numbers == material])
            if material == NO_MATERIAL:
                before = dr.gather(mi.Color3f, medium, some)
                segment = dr.exp(-before * dr.gather(mi.Float, hits.t, some))
                dr.scatter(kept, dr.gather(mi.Color3f, left, some) * segment, some)
                dr.eval(kept)
                continue
            shader = tracer.built.shaders[int(material)]
            if not shader.passes(filtered):
                continue
            si = tracer._interaction(stage, some)
            # The ray enters the body if it comes from outside.
            enters = dr.dot(mi.Vector3f(si.n), si.to_world(si.wi)) > 0
            if tracer.document.materials[int(material)].priority is None:
                found = shader.shadow(si, filtered)
            else:
                shape, within = dr.gather(mi.UInt32, hits.shape, some), dr.gather(mi.UInt64, inside, some)
                face = tracer.built.bodies.face(shape, within, enters)
                found = face.shadow(si)
                dr.scatter(entered, face.behind, some)
            before = dr.gather(mi.Color3f, medium, some)
            segment = dr.exp(-before * dr.gather(mi.Float, hits.t, some))
            rest = dr.gather(mi.Color3f, left, some) * segment * found.weight
            rest = dr.select(dr.max(rest) < dr.opaque(mi.Float, CUT), mi.Color3f(0), rest)
            after = before
            if filtered and found.straight is not True:
                after = dr.select(found.straight, before, dr.select(enters, found.inside, found.outside))
            dr.scatter(kept, rest, some)
            dr.scatter(behind, after, some)
            dr.eval(kept, behind, entered)
        alive = np.flatnonzero((dr.max(kept) > 0).numpy()[: len(real)])
        home = home[alive]
        onward = dr.select(finite, l, d)
        state = [hits.p, hits.n_g, hits.shape, hits.facet, onward, target, setting, key, path, behind, kept, entered, finite, margin]
        real = alive
    return _parts(share, width, len(bundles))


def _parts(share: Any, width: int, count: int) -> List[Any]:
    """The shares of each lamp."""
    return [dr.gather(mi.Color3f, share, dr.arange(mi.UInt32, width) + dr.opaque(mi.UInt32, k * width)) for k in range(count)]
