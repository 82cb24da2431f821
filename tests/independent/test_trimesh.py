"""Geometry: what our rays hit, compared with the same rays against trimesh's triangles."""

import json
import unittest
import warnings
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import copies
from copies import transposed, unmirrored
from support import Case, Json, Scene, label, public_models, render, skip, whitstone

try:
    import numpy as np
    import trimesh

    from rays import camera_rays, same_around, trace
except ImportError as missing:
    raise skip(f"{missing.name} is not installed") from None

# Our file has depths in single precision, rounded once: half a unit in the last place is 2^-24 of
# the value. Before that, rays and triangles are computed in double precision on both sides.
RELATIVE = 1.01 * 2.0**-24
# A hit nearer to an edge, in barycentric coordinates, is on the edge.
EDGE = 1e-9


class Triangles(NamedTuple):
    """World-space triangles, and of each the name of its mesh and its number there."""

    corners: Any
    owner: Any
    number: Any
    names: List[str]


def unread(root: Json) -> Optional[str]:
    """What of a model trimesh does not read."""
    if any("sparse" in accessor for accessor in root.get("accessors", [])):
        return "sparse accessors"
    if any("%" in buffer.get("uri", "") for buffer in root.get("buffers", [])):
        return "escaped names of files"
    for node in root.get("nodes", []):
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            return "EXT_mesh_gpu_instancing"
        if "skin" in node:
            return "skins"
    for mesh in root.get("meshes", []):
        for primitive in mesh["primitives"]:
            if primitive.get("mode", 4) == 6:
                return "fans"
            if "targets" in primitive:
                return "morph targets"
            position = root["accessors"][primitive["attributes"]["POSITION"]]
            if position.get("normalized"):
                return "normalised positions"
    return None


def load(path: Path) -> Triangles:
    """The triangles of a model as trimesh places them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = trimesh.load_scene(path, process=False, skip_materials=True)
    corners, owner, number = [], [], []
    names = list(scene.geometry)
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        vertices = np.asarray(mesh.vertices, float) @ matrix[:3, :3].T + matrix[:3, 3]
        corners.append(vertices[mesh.faces])
        owner.append(np.full(len(mesh.faces), names.index(name)))
        number.append(np.arange(len(mesh.faces)))
    return Triangles(np.concatenate(corners), np.concatenate(owner), np.concatenate(number), names)


class Comparison(NamedTuple):
    """What differs, and a summary."""

    faults: List[str]
    summary: str


def compare(scene: Scene, theirs: Triangles, shift: float = 0.0) -> Comparison:
    """Compares all pixels; on an edge, another triangle or none may be hit."""
    depth = scene.channels["depth.Z"]
    shape = scene.channels["shape_id.I"].astype(int)
    primitive = scene.channels["primitive_id.I"].astype(int)
    hits = trace(scene.view, theirs.corners, shift)
    faults = []
    inside = same_around(shape) | (hits.margin > EDGE)
    seen = shape >= 0
    if not seen.any():
        faults.append("nothing is seen")

    def report(what: str, wrong: Any) -> None:
        count = int(wrong.sum())
        if count:
            row, column = (int(part[0]) for part in np.nonzero(wrong))
            ours = (shape[row, column], primitive[row, column], depth[row, column])
            found = (int(hits.triangle[row, column]), float(hits.distance[row, column]))
            faults.append(f"{what}: {count} pixels, first ({column}, {row}): ours {ours}, trimesh's {found}")

    report("hit or miss", inside & (seen != (hits.triangle >= 0)))
    both = seen & (hits.triangle >= 0)
    # Where t is much shorter than the coordinates it is a difference of, their rounding counts.
    extent = np.abs(theirs.corners - scene.view.origin).max()
    error = np.where(both, np.abs(depth - hits.distance), 0)
    report("depth", both & inside & (error > RELATIVE * np.abs(depth) + 1e-13 * extent))

    # Same triangle of the same mesh. Coincident triangles are left out.
    pairs: Dict[Tuple[int, int], int] = {}
    known = both & inside & ~ambiguous(scene, theirs, hits)
    owner, number = theirs.owner[hits.triangle], theirs.number[hits.triangle]
    report("number of the triangle", known & (number != primitive))
    for mine, other in zip(shape[known], owner[known]):
        pairs[(int(mine), int(other))] = pairs.get((int(mine), int(other)), 0) + 1
    keys = [mine for mine, _ in pairs]
    # A shape of a group has one number for all instances; nodes of one mesh with different
    # materials or weights have several.
    if len(keys) != len(set(keys)):
        faults.append(f"shapes are several of trimesh's meshes: {pairs}")
    for mine, other in pairs:
        # trimesh names a mesh after the mesh in the file, so the number of triangles decides.
        count = int((theirs.owner == other).sum())
        top = int(primitive[shape == mine].max())
        if top >= count:
            faults.append(f"shape {mine} has triangle {top}, trimesh's has {count}")
    compared, hit = int((inside & both).sum()), int(both.sum())
    worst = float(np.where(inside & both, error / np.maximum(np.abs(depth), 1e-30), 0).max(initial=0))
    share = compared / max(hit, 1)
    bounds = theirs.corners.reshape(-1, 3)
    faults += outside(scene, bounds.min(0), bounds.max(0))
    summary = f"{len(theirs.corners)} triangles, {share:.0%} of {hit} pixels, worst relative depth {worst:.1e}"
    return Comparison(faults, summary)


def ambiguous(scene: Scene, theirs: Triangles, hits: Any) -> Any:
    """Pixels that see two of trimesh's triangles at one distance: equal corners, found twice."""
    rounded = np.sort(np.round(theirs.corners, 9).reshape(len(theirs.corners), -1), axis=1)
    _, inverse, counts = np.unique(rounded, axis=0, return_inverse=True, return_counts=True)
    twice = counts[inverse.reshape(-1)] > 1
    return np.where(hits.triangle >= 0, twice[hits.triangle], False)


def outside(scene: Scene, low: Any, high: Any) -> List[str]:
    """A fault if a point that we see lies outside of trimesh's bounds."""
    origins, directions = camera_rays(scene.view)
    depth = scene.channels["depth.Z"].reshape(-1)
    seen = scene.channels["shape_id.I"].reshape(-1) >= 0
    points = (origins + depth[:, None] * directions)[seen]
    error = 1e-6 * (np.abs(points).max(initial=0) + np.abs(scene.view.origin).max())
    beyond = (points < low - error).any() or (points > high + error).any()
    return [f"points outside of the bounds {low} to {high}"] if beyond else []


def triangles(path: Path, scene: Scene, folder: Path) -> int:
    """Our number of triangles, those of instances counted once per instance."""
    report = folder / "explained.json"
    ended = whitstone("explain", str(path), "--json", str(report))
    if ended.code:
        raise AssertionError(ended.messages)
    explained = json.loads(report.read_text())
    groups = {group["id"]: int(group["statistics"]["elements"]) for group in explained["groups"]}
    own = int(explained["elements"]) - sum(groups.values()) - len(scene.instances)
    return own + sum(groups[name] for name in scene.instances)


class TrimeshTest(Case):
    def check(self, path: Path) -> None:
        with self.subTest(model=label(path)):
            root, _ = copies.read(path)
            reason = unread(root)
            if reason is None and not root.get("meshes"):
                reason = "meshes: there are none"
            if reason is not None:
                print(f"skipped: {label(path)}: trimesh does not read {reason}")
                return
            folder = self.folder / "copy"
            try:
                copied = copies.copy(path, folder, copies.unlit, copies.single_nodes)
                scene = render(copied, folder)
            except FileNotFoundError as error:
                print(f"skipped: {label(path)}: {error}")
                return
            theirs = load(copied)
            found = compare(scene, theirs)
            print(f"trimesh: {label(path)}: {found.summary}")
            self.assertEqual(found.faults, [])
            self.assertEqual(triangles(copied, scene, folder), len(theirs.corners), "number of triangles")

    def test_own_models(self) -> None:
        for path in self.own:
            self.check(path)

    def test_public_models(self) -> None:
        for path in public_models():
            if "validator-negative" not in path.parts and copies.has_triangles(path):
                self.check(path)

    def test_faults_are_found(self) -> None:
        path = self.folder / "own" / "hierarchy.gltf"
        theirs = load(copies.copy(path, self.folder / "exact", copies.single_nodes))

        def faults(*changes: copies.Change, shift: float = 0.0) -> List[str]:
            folder = self.folder / "changed"
            copied = copies.copy(path, folder, copies.single_nodes, *changes)
            return compare(render(copied, folder), theirs, shift).faults

        self.assertEqual(faults(), [])
        self.assertNotEqual(faults(shift=0.5), [], "half a pixel")
        self.assertNotEqual(faults(shift=0.01), [], "a hundredth of a pixel")
        self.assertNotEqual(faults(transposed), [], "a transposed matrix")
        self.assertNotEqual(faults(unmirrored), [], "a scale without its sign")
        self.assertNotEqual(faults(swapped_triangles), [], "triangles in another order")


def swapped_triangles(root: Json) -> None:
    for mesh in root["meshes"]:
        for primitive in mesh["primitives"]:
            copies.change_indices(root, primitive["indices"], [0, 2, 3, 0, 1, 2])


if __name__ == "__main__":
    unittest.main()
