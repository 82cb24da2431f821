"""Shadow rays that surfaces attenuate instead of blocking (model §7)."""

from __future__ import annotations

from typing import Any

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

# Shadow rays end before a lamp by this relative margin: rounding must not put a surface at the lamp
# in front of it.
BEFORE_LAMP = 1 - 4 * ULP


def end_before(lamp: Any, reach: Any) -> Any:
    """The length of shadow rays to a lamp at this distance."""
    end = reach * BEFORE_LAMP
    return end - dr.opaque(mi.Float, lamp.margin) if lamp.margin > 0 else end


def through(tracer: Any, level: Any, lanes: Any, number: int, p: Any, n_g: Any, l: Any, goal: Any, counts: Any) -> Any:  # noqa: E741
    """The share of a lamp's light that arrives (Color3f). `lanes` are indices in the level; all
    other arrays have one entry per lane.
    """
    filtered = tracer.document.integrator.filtered
    rays = level.rays
    width = dr.width(lanes)
    share = dr.zeros(mi.Color3f, width)
    dr.make_opaque(share)
    setting = dr.gather(mi.UInt32, rays.setting, lanes)
    key = dr.gather(mi.UInt32, rays.key, lanes)
    path = mix(dr.gather(mi.UInt32, rays.path, lanes) + dr.opaque(mi.UInt32, 0x80000000 + number))
    medium = dr.gather(mi.Color3f, rays.medium, lanes) if filtered else dr.zeros(mi.Color3f, width)
    inside = dr.gather(mi.UInt64, rays.inside, lanes)
    shape, facet = dr.gather(mi.UInt32, level.hits.shape, lanes), dr.gather(mi.UInt32, level.hits.facet, lanes)
    left = mi.Color3f(dr.full(mi.Float, 1, width))
    # The indices of these lanes in `share`.
    home = np.flatnonzero(counts.numpy()[:width])
    real = home
    state = [p, n_g, shape, facet, l, goal if goal is not None else p, setting, key, path, medium, left, inside]
    for crossing in range(MOST_CROSSINGS):
        if len(real) == 0:
            break
        chosen = pad(real)
        state = [dr.gather(type(array), array, chosen) for array in state]
        p, n_g, shape, facet, l, target, setting, key, path, medium, left, inside = state  # noqa: E741
        start = tracer.leave(p, n_g, l, shape, facet, setting)
        o = start.o
        d, reach = l, dr.full(mi.Float, dr.inf, dr.width(l))
        if goal is not None:
            towards = target - o
            reach = dr.norm(towards)
            d = towards / reach
            reach = end_before(tracer.document.lights.lamps[number], reach)
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
        state = [hits.p, hits.n_g, hits.shape, hits.facet, d if goal is None else l, target, setting, key, path, behind, kept, entered]
        real = alive
    return share
