"""The Whitted tracer (model §6): breadth-first, with Mitsuba's intersections, BSDFs and emitters,
without random numbers.

All rays of one depth are traced together (a *level*), forward until no ray is left. Then radiance
is accumulated backward, from the deepest level to the camera, in the order of the model's
recursion: each node adds its reflected child first (for a glossy surface all of them in order),
then its transmitted one (through rough glass all of them in order). No two lanes ever write to the same location, so the result is
bit-identical for any number of threads and any division of the pixels into chunks. (Embree's result
for a ray does not depend on the other rays in a packet; this was measured lane by lane.)

Every number that can change between requests is passed as an evaluated array, never as a literal.
Literals become part of the kernel's code, and each new value would be compiled again. Arrays with
one entry also compile to separate kernels, so index lists are padded to two entries.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from . import footprints, gouraud, paths, shaders, shadows, spawn
from .lanes import Counts, Sums, TooDeep, branch_name, mix, pad
from .levels import Hits, Level, Rays
from .runtime import ULP, dr, mi
from .samplers import Samples
from .scene import NOTHING, Built, geometry
from .settings import Setting

# Upper bound on lanes traced together. A level takes about 300 bytes per lane.
LANES = 1 << 19

# Upper bound on lanes over all levels that wait for the backward pass; about 70 bytes per lane. If
# rays live for thousands of levels (between facing mirrors), fewer pixels are traced together
# instead.
RECORDS = 1 << 24

_BRANCH_NUMBERS = {"R": 1, "T": 2}


class Tracer:
    """Traces rays through one built scene, under one or several settings that share the geometry.
    """

    def __init__(self, built: Built, settings: Sequence[Setting], record: bool = False) -> None:
        assert all(geometry(setting) == built.geometry for setting in settings)
        self.built = built
        self.document = built.document
        self.settings = list(settings)
        self.record = record
        # Use Mitsuba's own uv instead of the model's: for the check against its integrators.
        self.native_uv = False
        self.counts = Counts()
        self.levels: List[Level] = []
        # Upper bounds on the number of branches of each kind per hit and of all that are spread,
        # and the number of lanes that stays below LANES after branching.
        materials = self.document.materials
        self.rays = {letter: max((material.rays(letter) for material in materials), default=1) for letter in "RT"}
        self.spread = max(sum(rays for rays in self.rays.values() if rays > 1), 1)
        self.lanes = LANES // self.spread
        # Whether any surface lets shadow rays pass.
        integrator = self.document.integrator
        used = {shape.material for shape in self.document.shapes}
        passed = any(built.shaders[number].passes(integrator.filtered) for number in used)
        self.through = integrator.shadows and (passed or not built.casts_shadow.all())
        table = self.settings + [self.settings[-1]]
        self._k = mi.Float(np.array([setting.k * ULP for setting in table], dtype=np.float32))
        self._noise = mi.Float(np.array([setting.ulps * ULP for setting in table], dtype=np.float32))
        self._largest = mi.Bool(np.array([setting.largest for setting in table]))
        self._seed = mi.UInt32(np.array([setting.seed for setting in table], dtype=np.uint32))
        self._faintest = dr.opaque(mi.Float, float(self.document.integrator.light_cutoff))
        self._cut = dr.opaque(mi.Float, float(self.document.integrator.min_contribution))
        self._pending: List[Any] = []
        self._budget: float = math.inf
        # The path classes, while `split` traces.
        self._classes: Optional[paths.Classes] = None
        # Positions that each pixel of the last call of `pixels` took, if the sampler is adaptive.
        self.taken: Optional[np.ndarray] = None

    # ---- pixels
    # ----------------------------------------------------------------------------------------------

    def pixels(self, x: np.ndarray, y: np.ndarray, setting: np.ndarray) -> np.ndarray:
        """(n, 3) float32: values of pixels (x[i], y[i]) under settings[setting[i]], as the mean
        over the sampler's positions.
        """
        samples = self.document.samples
        if samples.refinement is None:
            values = self._sums(x, y, setting, samples).total / len(samples)
        else:
            values = self._refined(x, y, setting)
        self._settle()
        return values.astype(np.float32)

    def _refined(self, x: np.ndarray, y: np.ndarray, setting: np.ndarray) -> np.ndarray:
        """(n, 3): pixel values with adaptive sampling; pixels double their number of samples as
        long as the model's rule requires.
        """
        samples, (width, height) = self.document.samples, (self.document.width, self.document.height)
        refinement = samples.refinement
        assert refinement is not None, "only adaptive samplers refine"
        lens = max(samples.lens, 1)
        # The first samples of all pixels and their neighbours, each pixel once per setting.
        offsets = np.array([(i, j) for j in (-1, 0, 1) for i in (-1, 0, 1)])
        near_x, near_y = x[:, None] + offsets[:, 0], y[:, None] + offsets[:, 1]
        there = (near_x >= 0) & (near_x < width) & (near_y >= 0) & (near_y < height)
        key = (setting[:, None].astype(np.int64) * height + near_y) * width + near_x
        unique, place = np.unique(key[there], return_inverse=True)
        taken = refinement.first
        found = self._sums(unique % width, unique // width % height, unique // width // height, samples.between(0, taken * lens))
        ranges = np.zeros(there.shape)
        ranges[there] = found.ranges()[place]
        middle = len(offsets) // 2
        near = np.delete(ranges, middle, axis=1).max(axis=1)
        own = np.zeros(there.shape, dtype=np.int64)
        own[there] = place
        state = found.of(own[:, middle])
        values = np.zeros((len(x), 3))
        self.taken = np.zeros(len(x), dtype=np.int64)
        active = np.arange(len(x))
        while True:
            most = taken == samples.sampler.count
            unfinished = (not most) & refinement.applies(taken * lens, state.ranges(), near[active])
            self.taken[active[~unfinished]] = taken
            values[active[~unfinished]] = state.total[~unfinished] / (taken * lens)
            active, state = active[unfinished], state.of(unfinished)
            if len(active) == 0:
                return values
            until = min(2 * taken, samples.sampler.count)
            state = state.with_(self._sums(x[active], y[active], setting[active], samples.between(taken * lens, until * lens), state.total))
            taken = until

    def _sums(self, x: np.ndarray, y: np.ndarray, setting: np.ndarray, samples: Samples, start: Optional[np.ndarray] = None) -> Sums:
        """The sum over these samples of each pixel, added to `start` if given, and the extremes."""
        step = max(1, self.lanes // len(samples))
        total = np.zeros((len(x), 3)) if start is None else start.copy()
        least, most = np.zeros((len(x), 3), dtype=np.float32), np.zeros((len(x), 3), dtype=np.float32)
        first = 0
        while first < len(x):
            span = slice(first, first + step)
            before = replace(self.counts), list(self._pending)
            self._budget = RECORDS if step > 1 else math.inf
            try:
                radiance = self.samples(x[span], y[span], setting[span], samples)
            except TooDeep:
                step = max(1, step // 2)
                self.counts, self._pending = before
                continue
            first += step
            for number in range(len(samples)):  # one after another: a fixed order of additions
                total[span] += radiance[:, number]
            least[span], most[span] = radiance.min(axis=1), radiance.max(axis=1)
        return Sums(total, least, most)

    def samples(self, x: np.ndarray, y: np.ndarray, setting: np.ndarray, samples: Samples) -> np.ndarray:
        """(n, samples, 3) float32: radiance at each position of each pixel."""
        radiance = self.trace(self.camera_rays(x, y, setting, samples), 0)
        return radiance.numpy().T[: len(x) * len(samples)].reshape(len(x), len(samples), 3)

    def split(self, x: np.ndarray, y: np.ndarray, samples: Samples, classes: paths.Classes) -> np.ndarray:
        """(classes, n, 3) float32: the values of pixels by path class, as means over the samples."""
        count = len(x) * len(samples)
        rays = self.camera_rays(x, y, np.zeros(len(x), dtype=np.int64), samples)
        rays.states = np.zeros(dr.width(rays.o), dtype=np.int64)
        counts, self._classes = replace(self.counts), classes
        try:
            found = self._trace(rays, 0)[1:]
        finally:
            self._classes = None
            # The rays of the image are counted already.
            self.counts = counts
            self._pending.clear()
        values = [value.numpy().T[:count].reshape(len(x), len(samples), 3).astype(np.float64) for value in found]
        return np.array([value.sum(axis=1) / len(samples) for value in values]).astype(np.float32)

    def camera_rays(self, x: np.ndarray, y: np.ndarray, setting: np.ndarray, samples: Samples) -> Rays:
        """Camera rays; the samples of a pixel are adjacent. If they have no lens sample, rays go
        through the centre of the lens.
        """
        count = len(x) * len(samples)
        shift = np.array([(s.dx, s.dy) for s in self.settings])[setting]
        positions, points = samples.positions(x, y), samples.points()
        raster_x = (x[:, None] + positions[:, :, 0] + shift[:, None, 0]).ravel()
        raster_y = (y[:, None] + positions[:, :, 1] + shift[:, None, 1]).ravel()
        number = np.tile(samples.numbers, len(x))
        pixel = np.repeat(y.astype(np.int64) * self.document.width + x, len(samples))
        which = np.repeat(setting, len(samples))
        point = np.full(count, -1) if points is None else np.tile(points, len(x))
        if count == 1:
            raster_x, raster_y, number, pixel, which, point = (
                np.repeat(a, 2) for a in (raster_x, raster_y, number, pixel, which, point)
            )
        width = len(raster_x)
        o, d = self.document.camera.rays(self.built.sensor, raster_x, raster_y, None if points is None else point)
        key = mix(mi.UInt32(pixel.astype(np.uint32)) + mix(mi.UInt32(number.astype(np.uint32))))
        rays = Rays(
            o, d, mi.Color3f(dr.full(mi.Float, 1, width)), dr.zeros(mi.Color3f, width), key, dr.full(mi.UInt32, 1, width),
            mi.UInt32(which.astype(np.uint32)), *spawn.no_surface(width), dr.zeros(mi.UInt64, width), real=count,
        )  # fmt: skip
        # Every lane needs its own memory: arrays that repeat one value are another kind of kernel
        # input.
        for array in rays.arrays():
            dr.make_opaque(array)
        rays.o, rays.d = self._perturb(rays.o, rays.d, rays.key, rays.path, rays.setting)
        dr.eval(rays.arrays())
        if self.document.footprints:
            distance = 1 / math.sqrt(self.document.samples.at_first())
            rays.differentials = footprints.of_camera(self.document.camera, raster_x, raster_y, None if points is None else point, distance)
        return rays

    # ---- rays
    # ----------------------------------------------------------------------------------------------

    def trace(self, rays: Rays, depth: int) -> Any:
        """Radiance along each ray (Color3f, evaluated)."""
        return self._trace(rays, depth)[0]

    def _trace(self, rays: Rays, depth: int) -> List[Any]:
        """Radiance along each ray; then that of each path class, if there are some."""
        levels: List[Level] = []
        radiance: Optional[List[Any]] = None
        kept = 0
        while True:
            level, children = self.level(rays, depth)
            levels.append(level)
            if self.record:
                self.levels.append(level)
            else:
                level.release()
            kept += rays.real
            if kept > self._budget:
                raise TooDeep
            if children is None:
                break
            depth += 1
            if children.real > self.lanes:
                # Each part is traced to its end before the next one starts, which bounds the
                # memory.
                pieces = [
                    self._trace(children.gather(np.arange(first, min(first + self.lanes, children.real))), depth)
                    for first in range(0, children.real, self.lanes)
                ]
                radiance = [_join_colors(list(parts)) for parts in zip(*pieces)]
                break
            rays = children
        for level in reversed(levels):
            locals_ = [level.local, *level.split]
            deeper = radiance or [None] * len(locals_)
            radiance = [self._backward(level, number, local, deeper[number]) for number, local in enumerate(locals_)]
        assert radiance is not None, "there is at least one level"
        return radiance

    def _backward(self, level: Level, number: int, local: Any, deeper: Any) -> Any:
        """The radiance of a level from that of the next one: local terms plus weighted children,
        times transmittance. Number 0 is all of it, the others are the path classes.
        """
        radiance = local
        for link, (_, parents, weight, children, limit) in enumerate(level.links):
            lanes = pad(parents)
            if children is not None:
                value = dr.gather(mi.Color3f, deeper, pad(children))
            elif number == 0:
                value = limit
            else:
                among = level.limits[link]
                assert among is not None, "the link is at the limit"
                value = dr.select(mi.Bool(among[number - 1]), limit, 0)
            sum_ = dr.gather(mi.Color3f, radiance, lanes) + weight * value
            radiance = mi.Color3f(radiance)
            dr.scatter(radiance, sum_, lanes)
            dr.eval(radiance)
        radiance = radiance * level.transmittance
        dr.eval(radiance)
        return radiance

    def level(self, rays: Rays, depth: int) -> Tuple[Level, Optional[Rays]]:
        """Intersects and shades one level. Returns the rays of the next level, or None."""
        hits = self.intersect(rays)
        self.counts.closest += rays.real
        level = Level(rays, hits, hits.local, hits.transmittance)
        if rays.differentials is not None:
            level.footprint = self.built.surfaces.meet(rays, hits)
        # Group lanes by material: a stable sort of their numbers.
        numbers = hits.material.numpy()[: max(rays.real, 1)]
        order = np.argsort(numbers, kind="stable").astype(np.uint32)
        starts = np.searchsorted(numbers[order], np.arange(len(self.document.materials) + 1))
        groups = {
            number: order[starts[number] : starts[number + 1]]
            for number in range(len(self.document.materials))
            if starts[number + 1] > starts[number]
        }
        if self._classes is not None:
            level.parts = {end: mi.Color3f(dr.zeros(mi.Float, dr.width(hits.t))) for end in ("DL", "DA", "O")}
            for part in level.parts.values():
                dr.make_opaque(part)
            level.parts["B"] = mi.Color3f(hits.local)
        local = self._gouraud if self.document.integrator.gouraud else self._local
        local(level, {number: lanes for number, lanes in groups.items() if self.document.materials[number].smooth})
        if self._classes is not None:
            assert rays.states is not None, "the camera rays have states"
            for end, part in level.parts.items():
                for number, among in enumerate(self._classes.ends(rays.states, end)):
                    if number == len(level.split):
                        level.split.append(mi.Color3f(0))
                    level.split[number] = level.split[number] + dr.select(mi.Bool(among), part, 0)
            dr.eval(level.split)
        children = self._branches(level, groups, depth) if self.document.integrator.follow else None
        return level, children

    def intersect(self, rays: Rays) -> Hits:
        """The nearest hits, with the model's normals, uv and numbers.

        A ray that re-hits the facet that it left starts again with a larger offset; no other ray is
        changed.
        """
        hits = self._nearest(rays)
        lanes = np.flatnonzero(hits.rehit.numpy()[: rays.real])
        self.counts.respawned += len(lanes)
        for attempt in range(1, spawn.ATTEMPTS + 1):
            if len(lanes) == 0:
                break
            again = rays.gather(lanes)
            again.o = spawn.farther(again.o, again.left_push, attempt)
            dr.eval(again.o)
            found, here = self._nearest(again), pad(lanes)
            for name in found.__dataclass_fields__:
                dr.scatter(getattr(hits, name), getattr(found, name), here)
            dr.eval([getattr(hits, name) for name in hits.__dataclass_fields__])
            lanes = lanes[found.rehit.numpy()[: len(lanes)]]
        self.counts.rehits += len(lanes)
        return hits

    def _nearest(self, rays: Rays) -> Hits:
        """`intersect` for unchanged ray origins."""
        b = self.built
        si = b.scene.ray_intersect(mi.Ray3f(rays.o, rays.d))
        valid = si.is_valid()
        registry = dr.reinterpret_array(mi.UInt32, si.shape)
        shape = dr.select(valid, dr.gather(mi.UInt32, b.shape_of_registry, registry, valid), NOTHING)
        n_g = mi.Vector3f(si.n) * dr.gather(mi.Float, b.flip, shape, valid)
        interpolated = mi.Vector3f(si.sh_frame.n)
        # Mitsuba normalises a zero normal to NaN.
        smooth = (dr.gather(mi.UInt32, b.smooth_normals, shape, valid) == 1) & (dr.squared_norm(interpolated) > 0)
        n_raw = dr.select(smooth, interpolated, n_g)
        # Rule S: the viewer must be on the same side of n_s as of n_g.
        n_s = dr.select(dr.dot(rays.d, n_raw) * dr.dot(rays.d, n_g) < 0, -n_raw, n_raw)
        rule = dr.gather(mi.UInt32, b.primitive_rule, shape, valid)
        primitive = dr.select(rule == 0, 0, si.prim_index // dr.maximum(rule, 1))
        facet = spawn.facet(rule, si.prim_index)
        uv, p, t = mi.Point2f(si.uv), mi.Point3f(si.p), mi.Float(si.t)
        flat = [dr.gather(mi.Float, b.flats, shape * 4 + entry, valid) for entry in range(4)]
        normal = mi.Vector3f(*flat[:3])
        p = mi.Point3f(p - normal * (dr.dot(normal, p) - flat[3]))
        t, p, n_g, n_s, n_raw = b.balls.refine(rays.o, rays.d, shape, valid, t, p, n_g, n_s, n_raw)
        if not self.native_uv:
            rule = dr.gather(mi.UInt32, b.uv_rule, shape, valid)
            uv.y = dr.select(rule == 1, 1 - uv.y, uv.y)
            row = [dr.gather(mi.Float, b.plane_rows, shape * 8 + entry, valid & (rule == 2)) for entry in range(8)]
            x = row[0] * p.x + row[1] * p.y + row[2] * p.z + row[3]
            y = row[4] * p.x + row[5] * p.y + row[6] * p.z + row[7]
            uv = dr.select(rule == 2, mi.Point2f(x, y), uv)
            uv = b.balls.wrapped(shape, valid, p, uv)
        if b.host is not None:
            valid, values = b.host.combine(rays, valid, [t, p, n_g, n_s, n_raw, uv, shape, primitive, facet])
            t, p, n_g, n_s, n_raw, uv, shape, primitive, facet = values
        t = dr.select(valid, t, dr.inf)
        endless = dr.select(rays.medium == 0, mi.Color3f(1), mi.Color3f(0))
        transmittance = dr.select(valid, dr.exp(-rays.medium * t), endless)
        background = b.behind(rays.d)
        hits = Hits(
            valid=valid,
            t=t,
            p=p,
            n_g=n_g,
            n_s=n_s,
            n_raw=n_raw,
            uv=uv,
            shape=shape,
            primitive=primitive,
            facet=facet,
            material=dr.select(valid, dr.gather(mi.UInt32, b.material_of_shape, shape, valid), NOTHING),
            transmittance=transmittance,
            throughput=rays.throughput * transmittance,
            local=dr.select(valid, mi.Color3f(0), background),
            rehit=valid & (shape == rays.left_shape) & (facet == rays.left_facet) & (t < rays.left_within),
        )
        dr.eval([getattr(hits, name) for name in hits.__dataclass_fields__])
        return hits

    def _interaction(self, level: Level, lanes: Any) -> Any:
        """Mitsuba's surface interaction at some lanes, with the model's frame and uv, for BSDFs and
        emitters.
        """
        hits = level.hits
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(lanes))
        si.t = dr.gather(mi.Float, hits.t, lanes)
        si.p = dr.gather(mi.Point3f, hits.p, lanes)
        si.n = mi.Normal3f(dr.gather(mi.Vector3f, hits.n_g, lanes))
        si.uv = dr.gather(mi.Point2f, hits.uv, lanes)
        si.sh_frame = mi.Frame3f(dr.gather(mi.Vector3f, hits.n_s, lanes))
        si.wi = si.to_local(-dr.gather(mi.Vector3f, level.rays.d, lanes))
        if level.footprint is not None:
            level.footprint.put(si, lanes.numpy())
        if self.document.gradients:
            si.dp_du, si.dp_dv = (
                mi.Vector3f(np.ascontiguousarray(rows.T, dtype=np.float32)) for rows in self.built.surfaces.gradients(hits, lanes.numpy())
            )
        if self.built.vertices.any:
            self.built.vertices.put(si, dr.gather(mi.UInt32, hits.shape, lanes), dr.gather(mi.UInt32, hits.facet, lanes))
        return si

    # ---- local terms
    # ---------------------------------------------------------------------------------------------

    def _local(self, level: Level, groups: Dict[int, np.ndarray]) -> None:
        """Adds ambient terms and direct lighting at the lanes of materials that are not purely
        specular.
        """
        if not groups:
            return
        lanes_all = np.concatenate(list(groups.values()))
        lit = self._lamps(level, lanes_all)
        first = 0
        for number, lanes in groups.items():
            here, inner = pad(lanes), pad(np.arange(first, first + len(lanes)))
            first += len(lanes)
            si = self._interaction(level, here)
            total = mi.Color3f(0)
            shader = self.built.shaders[number]
            ambient, emission = shader.ambient(si) * self.built.ambient_light, shader.emission(si)
            total = total + ambient
            if self.record:
                dr.eval(total)
                level.ambient.append((lanes, mi.Color3f(total)))
            total = total + emission
            lit_by_lamps = mi.Color3f(0)
            for lamp, (direction, irradiance, visible) in enumerate(lit):
                wo = si.to_local(dr.gather(mi.Vector3f, direction, inner))
                value = shader.local(si, wo) * dr.gather(mi.Color3f, irradiance, inner)
                total = total + value
                lit_by_lamps = lit_by_lamps + value
                if self.record:
                    seen = dr.gather(mi.Bool, visible, inner)
                    dr.eval(value, seen)
                    level.lamps.append((lanes, self.document.lights.lamps[lamp].index, seen, value))
            dr.scatter(level.local, total, here)
            dr.eval(level.local)
            if level.parts:
                for end, part in (("DL", lit_by_lamps), ("DA", ambient), ("O", emission)):
                    dr.scatter(level.parts[end], mi.Color3f(part), here)
                dr.eval(level.parts)

    def _gouraud(self, level: Level, groups: Dict[int, np.ndarray]) -> None:
        """Adds the interpolated local terms of the vertices of the triangles (Gouraud shading)."""
        hits, rays = level.hits, level.rays
        valid, shape, primitive = (array.numpy() for array in (hits.valid, hits.shape, hits.primitive))
        points = np.array(hits.p).reshape(3, -1).T.astype(np.float64)
        total = mi.Color3f(hits.local)
        for position, normal, uv, weight in gouraud.corners(self.built, valid, shape, primitive, points):
            p = mi.Point3f(np.ascontiguousarray(position.T, dtype=np.float32))
            n_raw = mi.Vector3f(np.ascontiguousarray(normal.T, dtype=np.float32))
            v = dr.normalize(rays.o - p)
            n_raw = dr.select(dr.dot(n_raw, n_raw) > 0, dr.normalize(n_raw), hits.n_g)
            n_s = dr.select(dr.dot(v, n_raw) * dr.dot(v, hits.n_g) < 0, -n_raw, n_raw)
            place = mi.Point2f(np.ascontiguousarray(uv.T, dtype=np.float32))
            dark = mi.Color3f(dr.zeros(mi.Float, dr.width(p)))
            dr.make_opaque(dark)
            direction = mi.Vector3f(-v)
            dr.eval(p, direction, n_s, place)
            corner = Level(replace(rays, d=direction), replace(hits, p=p, n_s=n_s, uv=place, local=dark), dark, hits.transmittance)
            self._local(corner, groups)
            total = total + mi.Float(weight.astype(np.float32)) * corner.local
        dr.eval(total)
        hits.local = level.local = total

    def _lamps(self, level: Level, lanes_here: np.ndarray) -> List[Tuple[Any, Any, Any]]:
        """(direction, irradiance, visible) of each lamp at some lanes; the irradiance is 0 where
        rule G excludes it.
        """
        lanes = pad(lanes_here)
        numbers = range(len(self.built.emitters))
        lit = [self._unshadowed(level, number, lanes) for number in numbers]
        bundles = [bundle for bundle, _, _ in lit]
        shares = shadows.through(self, level, lanes, bundles) if self.through else []
        result = []
        for number, (bundle, irradiance, n) in zip(numbers, lit):
            counts = visible = bundle.counts
            if self.through:
                irradiance = irradiance * shares[number]
                visible = counts & (dr.max(shares[number]) > 0)
            elif self.document.integrator.shadows:
                visible = counts & ~self._shadowed(level, lanes, bundle)
                self._count("shadow", counts, len(lanes_here))
            irradiance = dr.select(visible, irradiance, 0)
            # Where the lamp does not count, the direction may be NaN; the product with 0 must be 0.
            l = dr.select(counts, bundle.l, n)  # noqa: E741 (the model's name)
            dr.eval(l, irradiance, visible)
            result.append((l, irradiance, visible))
        return result

    def _unshadowed(self, level: Level, number: int, lanes: Any) -> Tuple[shadows.Bundle, Any, Any]:
        """The shadow rays to a lamp, its irradiance without shadows, and the shading normals on the
        side of the viewer.
        """
        lamp, emitter = self.document.lights.lamps[number], self.built.emitters[number]
        hits, rays = level.hits, level.rays
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(lanes))
        si.p = dr.gather(mi.Point3f, hits.p, lanes)
        si.t = mi.Float(1)
        n_g, n_s = dr.gather(mi.Vector3f, hits.n_g, lanes), dr.gather(mi.Vector3f, hits.n_s, lanes)
        v = -dr.gather(mi.Vector3f, rays.d, lanes)
        ds, irradiance = emitter.sample_direction(si, mi.Point2f(0.5), True)
        l = mi.Vector3f(ds.d)  # noqa: E741 (the model's name)
        side = dr.dot(n_g, v)
        n = dr.select(side >= 0, n_s, -n_s)
        counts = (dr.dot(n_g, l) * side > 0) & (dr.dot(n, l) > 0) & (dr.max(irradiance) > 0)
        if self.document.integrator.light_cutoff > 0:
            counts &= dr.max(irradiance) >= self._faintest
        if lamp.finite:
            counts &= ds.dist > 0
        goal = ds.p if lamp.finite else None
        if lamp.normal is not None:
            goal = ds.p + mi.Vector3f(*[dr.opaque(mi.Float, lamp.off * axis) for axis in lamp.normal])
        return shadows.Bundle(number, si.p, n_g, l, goal, counts), irradiance, n

    def _shadowed(self, level: Level, lanes: Any, bundle: shadows.Bundle) -> Any:
        """Whether a surface lies strictly between the point and the lamp (at `goal`, or infinitely
        far along `l`).
        """
        rays = level.rays
        number, p, n_g, l, goal = bundle.number, bundle.p, bundle.n_g, bundle.l, bundle.goal  # noqa: E741
        active = bundle.counts
        setting = dr.gather(mi.UInt32, rays.setting, lanes)
        key, path = dr.gather(mi.UInt32, rays.key, lanes), dr.gather(mi.UInt32, rays.path, lanes)
        path = mix(path + dr.opaque(mi.UInt32, 0x80000000 + number))
        shape, facet = dr.gather(mi.UInt32, level.hits.shape, lanes), dr.gather(mi.UInt32, level.hits.facet, lanes)
        left = self.leave(p, n_g, l, shape, facet, setting)

        def ray(o: Any, l: Any, goal: Any, key: Any, path: Any, setting: Any) -> Any:  # noqa: E741
            d, reach = l, dr.full(mi.Float, dr.largest(mi.Float), dr.width(o))
            if goal is not None:
                towards = goal - o
                reach = dr.norm(towards)
                d = towards / reach
                reach = shadows.end_before(self.document.lights.lamps[number], reach)
            o, d = self._perturb(o, d, key, path, setting)
            return mi.Ray3f(o, d, reach, mi.Float(0), [])

        shadowed = self.built.scene.ray_test(ray(left.o, l, goal, key, path, setting), active)
        dr.eval(shadowed, active, left.arrays())
        # Rays that are blocked by the facet that they left start again with a larger offset.
        blocked = np.flatnonzero((shadowed & active).numpy()[: len(lanes)])
        for attempt in range(spawn.ATTEMPTS + 1):
            if len(blocked) == 0:
                break
            some = pad(blocked)
            state = [None if array is None else dr.gather(type(array), array, some) for array in (l, goal, key, path, setting)]
            here = left.gather(some)
            found = self._preliminary(ray(spawn.farther(here.o, here.push, attempt), *state))
            again = found.valid & (found.shape == here.shape) & (found.facet == here.facet) & (found.t < here.within)
            dr.scatter(shadowed, found.valid, some)
            dr.eval(shadowed, again)
            blocked = blocked[again.numpy()[: len(blocked)]]
            if attempt == 0:
                self.counts.respawned += len(blocked)
        self.counts.rehits += len(blocked)
        if self.built.host is not None:
            test = ray(left.o, l, goal, key, path, setting)
            shadowed = shadowed | self.built.host.occluded(test.o, test.d, test.maxt, left)
        return shadowed

    def _preliminary(self, ray: Any) -> spawn.Met:
        """The first hit of a ray, without the surface data."""
        b = self.built
        pi = b.scene.ray_intersect_preliminary(ray)
        valid = pi.is_valid()
        shape = dr.gather(mi.UInt32, b.shape_of_registry, dr.reinterpret_array(mi.UInt32, pi.shape), valid)
        facet = spawn.facet(dr.gather(mi.UInt32, b.primitive_rule, shape, valid), pi.prim_index)
        return spawn.Met(valid, pi.t, shape, facet)

    # ---- branches
    # ----------------------------------------------------------------------------------------------

    def _branches(self, level: Level, groups: Dict[int, np.ndarray], depth: int) -> Optional[Rays]:
        """The delta branches of a level: links from children to parents, and the rays of the next
        level.
        """
        integrator = self.document.integrator
        last = depth >= integrator.max_depth
        if last and not integrator.limit_background:
            return None
        parts: List[Rays] = []
        weights: List[Any] = []
        # By branch: parents, and lane indices in the concatenated parts.
        found: Dict[str, List[Tuple[np.ndarray, np.ndarray]]] = {}
        offset = 0
        # Reflections before transmissions; those that are spread in order.
        for letter, which in [(kind, index) for kind in "RT" for index in range(self.rays[kind])]:
            for number, lanes in groups.items():
                material = self.document.materials[number]
                if letter not in material.branches or which >= material.rays(letter):
                    continue
                rays, weight, keep = self._branch(level, number, letter, which, pad(lanes))
                kept = np.flatnonzero(keep.numpy()[: len(lanes)])
                if len(kept) == 0:
                    continue
                parts.append(rays)
                weights.append(weight)
                name = branch_name(letter, material.rays(letter), which)
                found.setdefault(name, []).append((lanes[kept], kept + offset))
                offset += dr.width(keep)
        if not parts:
            return None
        everything = Rays.concatenate(parts)
        all_weights = _join_colors(weights)
        first = 0
        chosen: List[np.ndarray] = []
        for letter in sorted(found):
            parents = np.concatenate([entry[0] for entry in found[letter]])
            places = np.concatenate([entry[1] for entry in found[letter]])
            weight = dr.gather(mi.Color3f, all_weights, pad(places))
            limit, children = None, None
            if last:
                medium = dr.gather(mi.Color3f, everything.medium, pad(places))
                background = self.built.behind(dr.gather(mi.Vector3f, everything.d, pad(places)))
                limit = dr.select(medium == 0, background, 0)
                dr.eval(limit)
            else:
                children = np.arange(first, first + len(places))
            dr.eval(weight)
            level.links.append((letter, parents, weight, children, limit))
            among = None
            if self._classes is not None and last:
                assert everything.states is not None, "the rays have states"
                among = self._classes.ends(everything.states[pad(places).numpy()], "B")
            level.limits.append(among)
            chosen.append(places)
            first += len(places)
        return None if last else everything.gather(np.concatenate(chosen))

    def _branch(self, level: Level, number: int, letter: str, which: int, lanes: Any) -> Tuple[Rays, Any, Any]:
        """One branch of one material at its lanes; `which` is its number among several. Returns
        rays, weight, and the lanes to follow.
        """
        hits, rays = level.hits, level.rays
        si = self._interaction(level, lanes)
        n_g = mi.Vector3f(si.n)
        side = -dr.dot(n_g, dr.gather(mi.Vector3f, rays.d, lanes))
        inside = dr.gather(mi.UInt64, rays.inside, lanes)
        if self.document.materials[number].priority is None:
            found = self.built.shaders[number].branch(letter, si, which)
        else:
            face = self.built.bodies.face(dr.gather(mi.UInt32, hits.shape, lanes), inside, side > 0)
            found = face.branch(letter, si)
            inside = face.before if letter == "R" else face.behind
        assert found is not None, "the material has this branch"
        weight = found.weight
        direction = mi.Vector3f(si.to_world(found.wo))
        leaving = dr.dot(n_g, direction) * side
        throughput = dr.gather(mi.Color3f, hits.throughput, lanes) * weight
        strength = dr.max(throughput)
        keep = (strength > 0) & (strength >= self._cut) & ((leaving > 0) if letter == "R" else (leaving < 0))
        # One entry per lane, even if all are equal.
        weight = dr.select(keep, weight, 0)
        medium = dr.gather(mi.Color3f, rays.medium, lanes)
        if letter == "T" and found.straight is not True:
            entered = dr.select(side > 0, found.inside, found.outside)
            medium = dr.select(found.straight, medium, entered)
        setting = dr.gather(mi.UInt32, rays.setting, lanes)
        key = dr.gather(mi.UInt32, rays.key, lanes)
        path = mix(dr.gather(mi.UInt32, rays.path, lanes) * 4 + dr.opaque(mi.UInt32, _BRANCH_NUMBERS[letter] + 4 * which))
        shape, facet = dr.gather(mi.UInt32, hits.shape, lanes), dr.gather(mi.UInt32, hits.facet, lanes)
        left = self.leave(si.p, n_g, direction, shape, facet, setting)
        o, direction = self._perturb(left.o, direction, key, path, setting)
        spawned = Rays(o, direction, throughput, medium, key, path, setting, left.shape, left.facet, left.within, left.push, inside)
        dr.eval(spawned.arrays(), weight, keep)
        if self._classes is not None:
            assert rays.states is not None, "the rays have states"
            event = "T" if letter == "T" else "G" if self.document.materials[number].spread > 1 else "S"
            spawned.states = self._classes.after(rays.states[lanes.numpy()], event)
        if level.footprint is not None:
            spawned.differentials = footprints.branch(level, lanes.numpy(), letter, found, self._bent(level, number, letter, si, lanes.numpy()))
        return spawned, weight, keep

    def _bent(self, level: Level, number: int, letter: str, si: Any, lanes: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """The normals by which a branch of a material is bent, with their changes along the steps."""
        normal, change = footprints.normals(level, lanes)
        if not self.document.materials[number].normal_mapped:
            return normal, change
        assert level.footprint is not None, "the document has footprints"
        steps = shaders.Steps(level.footprint.position[lanes], level.footprint.uv[lanes], normal, change)
        found = self.built.shaders[number].steps(letter, si, steps)
        return found.normal, found.change

    # ---- numbers
    # ----------------------------------------------------------------------------------------------

    def leave(self, p: Any, n_g: Any, direction: Any, shape: Any, facet: Any, setting: Any) -> spawn.Spawned:
        """The origin of a ray in this direction: `spawn.leave` with the setting's K."""
        left = spawn.leave(self.built, p, n_g, direction, shape, facet, dr.gather(mi.Float, self._k, setting))
        if self.built.host is not None:
            self.built.host.leave(left, p, n_g, direction)
        return left

    def _perturb(self, o: Any, d: Any, key: Any, path: Any, setting: Any) -> Tuple[Any, Any]:
        """Origin and direction with each component times 1 + ulps * 2^-24 * r, where r is a hash in
        [-1, 1]; ulps = 0 is exact.

        With `largest`, the perturbation is relative to the largest component of the vector instead.
        """
        noise = dr.gather(mi.Float, self._noise, setting)
        largest = dr.gather(mi.Bool, self._largest, setting)
        base = mix(dr.gather(mi.UInt32, self._seed, setting) + mix(key + mix(path)))

        def moved(vector: Any, axis: int, component: int) -> Any:
            r = mi.Float(mi.Int32(mix(base + component * 0x1B873593))) * 2.0**-31
            size = dr.select(largest, dr.max(dr.abs(vector)), vector[axis])
            return vector[axis] + size * (noise * r)

        return (
            mi.Point3f(*[moved(o, axis, axis) for axis in range(3)]),
            mi.Vector3f(*[moved(d, axis, 3 + axis) for axis in range(3)]),
        )

    def _count(self, name: str, mask: Any, real: int) -> None:
        """Records that the lanes where `mask` holds are to be counted; a single lane was padded
        with its own duplicate.
        """
        self._pending.append((name, dr.count(mask), 2 if real == 1 else 1))

    def _settle(self) -> None:
        """Evaluates the recorded counts (they stay lazy until here, to avoid waiting)."""
        for name, count, copies in self._pending:
            setattr(self.counts, name, getattr(self.counts, name) + int(count[0]) // copies)
        self._pending.clear()


def _join_colors(parts: Sequence[Any]) -> Any:
    if len(parts) == 1:
        return parts[0]
    joined = mi.Color3f(*[dr.concat([part[channel] for part in parts]) for channel in range(3)])
    dr.eval(joined)
    return joined
