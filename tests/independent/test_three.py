"""Base colours, normals and texture coordinates, compared pixel by pixel with three.js."""

import unittest
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

import browser
import copies
from copies import transposed, unmirrored
from support import (
    HEIGHT,
    MODULES,
    WIDTH,
    Case,
    Json,
    Scene,
    label,
    public_models,
    render,
    skip,
)

try:
    import numpy as np

    from rays import differences, same_around
except ImportError as missing:
    raise skip(f"{missing.name} is not installed") from None

# three.js renders this number of pixels per pixel along each axis; the middle one is compared.
# SwiftShader snaps vertices to 1/16 of its pixels, which moves values by up to 1/32 of them.
FACTOR = 5
# Largest difference, in pixels: the value may be that of a point so far away.
MOVED = 1 / 32 / FACTOR * 2
# Errors of single precision in shaders, for values of about 1.
ROUNDING = 2e-5
# SwiftShader filters with weights of 8 bits, which are half a unit of them wrong.
FILTERED = 0.5 / 256
# Decoders of JPEG differ by a code; where sRGB is steepest it is 2.3/255.
JPEG = 2.3 / 255
# A pixel is compared where each value differs by less than this from the mean of opposite
# neighbours: other pixels see an edge.
SMOOTH = {"normal": 0.02, "uv": 0.02}
# Largest change of a colour over this way: other pixels see an edge in an image.
CONTRAST = 0.02
# At least this part of the pixels that see a surface must be compared. Public models may be finer.
SHARE = 0.5


class Images(NamedTuple):
    """Colour, coverage, normal, distance, texture coordinates, and the change of the colour
    over a way of MOVED pixels, top row first.
    """

    color: Any
    covered: Any
    normal: Any
    distance: Any
    uv: Any
    contrast: Any


def ours(scene: Scene) -> Images:
    channels = scene.channels

    def stack(*names: str) -> Any:
        return np.stack([channels[name] for name in names], axis=-1)

    covered = channels["shape_id.I"] >= 0
    normal = stack("normal.X", "normal.Y", "normal.Z")
    return Images(stack("R", "G", "B"), covered, normal, channels["depth.Z"], stack("uv.U", "uv.V"), None)


def job(address: str, scene: Scene, shift: float = 0.0) -> Json:
    """What the page needs to know of a scene."""
    view = scene.view
    depth = scene.channels["depth.Z"]
    seen = scene.channels["shape_id.I"] >= 0
    # Distances along the view are at most those along the rays, and at least half of them for the
    # angles of view here.
    low, high = (float(depth[seen].min()), float(depth[seen].max())) if seen.any() else (1.0, 2.0)
    near = max(view.near, 0.25 * low) if view.near >= 0 and low > 0 else view.near
    camera: Dict[str, Any] = {key: getattr(view, key).tolist() for key in ("origin", "u", "v", "w")}
    camera.update(window=view.window, orthographic=view.orthographic, near=near, far=2 * high, shift=shift)
    shapes = {
        f"{shape.mesh}/{shape.primitive}": {"set": shape.first_set, "grouped": shape.grouped}
        for shape in scene.shapes
        if shape.mesh >= 0
    }
    return {
        "model": address,
        "width": WIDTH,
        "height": HEIGHT,
        "factor": FACTOR,
        "moved": MOVED,
        "camera": camera,
        "shapes": shapes,
    }


def theirs(data: bytes) -> Images:
    passes = np.frombuffer(data, "<f4").reshape(3, HEIGHT, WIDTH, 4)[:, ::-1].astype(float)
    color, normal, uv = passes
    # Theirs has v down.
    coordinates = np.stack([uv[..., 0], 1 - uv[..., 1]], axis=-1)
    return Images(color[..., :3], color[..., 3] > 0, normal[..., :3], normal[..., 3], coordinates, uv[..., 2])


class Comparison(NamedTuple):
    """What differs, the part of the pixels that is compared, and a summary."""

    faults: List[str]
    share: float
    summary: str


def compare(scene: Scene, mine: Images, other: Images, image: float) -> Comparison:
    """Compares all pixels away from edges. `image`: tolerance of colours from images."""
    faults = []
    whole = same_around(scene.channels["shape_id.I"]) & same_around(scene.channels["primitive_id.I"])
    # Instances share their numbers.
    shared = np.array([shape.grouped for shape in scene.shapes] + [False])
    whole &= ~shared[scene.channels["shape_id.I"].astype(int)]
    same = same_around(scene.channels["shape_id.I"])
    seen = mine.covered
    if not seen.any():
        faults.append("nothing is seen")
    # A part that is thinner than a pixel may be missed by one side.
    wrong = same & same_around(other.covered) & (mine.covered != other.covered)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        faults.append(f"covered: {int(wrong.sum())} pixels, first ({column}, {row})")
    inside = same & mine.covered & other.covered
    slopes = {}
    for name, limit in SMOOTH.items():
        slopes[name], bend = differences(getattr(mine, name))
        inside &= whole | (bend < limit)
    distance = np.where(mine.covered, mine.distance, 0)[..., None]
    slopes["distance"], bend = differences(distance)
    # The edge of a shape in front of itself.
    inside &= whole | (bend < 0.02 * mine.distance)
    slopes["color"], _ = differences(mine.color)
    # Which texel is nearest depends on rounding at the border of texels.
    colors = inside & (other.contrast < (1e-3 if scene.nearest else CONTRAST))
    scale = max(float(np.abs(mine.distance[inside]).max(initial=0)), 1e-30)
    tolerances = {"normal": ROUNDING, "uv": ROUNDING, "distance": ROUNDING * scale, "color": image}
    worst = []
    for name, rounding in tolerances.items():
        mask = colors if name == "color" else inside
        first, second = getattr(mine, name), getattr(other, name)
        if first.ndim == 2:
            first, second = first[..., None], second[..., None]
        size = np.abs(first).max(-1).clip(1) if name == "uv" else 1.0
        error = np.abs(first - second).max(-1)
        allowed = MOVED * np.where(np.isfinite(slopes[name]), slopes[name], 0) + rounding * size
        if name == "color":
            # An image may change faster than the colours of neighbouring pixels tell.
            allowed = allowed + 2 * other.contrast
        excess = np.where(mask, error / allowed, -1)
        row, column = np.unravel_index(int(excess.argmax()), excess.shape)
        worst.append(f"{name} {error[row, column]:.1e} of {allowed[row, column]:.1e} at ({column}, {row})")
        beyond = excess > 1
        if beyond.any():
            values = f"ours {first[row, column]}, theirs {second[row, column]}"
            faults.append(f"{name}: {int(beyond.sum())} pixels, worst {worst[-1]}: {values}")
    share = int(inside.sum()) / max(int(seen.sum()), 1)
    of_colors = int(colors.sum()) / max(int(seen.sum()), 1)
    pixels = f"{share:.0%} of {int(seen.sum())} pixels and {of_colors:.0%} of their colours"
    return Comparison(faults, min(share, of_colors), f"{pixels}, {', '.join(worst)}")


def image_tolerance(root: Json) -> float:
    """The tolerance of colours: that of images, or of the shader where there are none."""
    images = root.get("images", [])
    if not images:
        return ROUNDING
    names = [image.get("mimeType", "") + image.get("uri", "")[:16] + image.get("uri", "")[-5:] for image in images]
    jpeg = any("jp" in name for name in names)
    return FILTERED + (JPEG if jpeg else 0)


class ThreeTest(Case):
    page: browser.Browser

    @classmethod
    def setUpClass(cls) -> None:
        chromium = browser.program()
        if chromium is None:
            raise skip("Chromium is not installed")
        if not (MODULES / "three").is_dir():
            raise skip("three.js is not installed")
        super().setUpClass()
        cls.page = browser.Browser(chromium, MODULES, cls.folder)
        cls.addClassCleanup(cls.page.close)
        if not cls.page.ready.wait(60):
            raise TimeoutError("Chromium does not open the page")

    def compared(self, path: Path, *changes: copies.Change, shift: float = 0.0) -> Comparison:
        """Compares a model with itself; `changes` change only the model that we render."""
        folder = self.folder / "copy"
        plain = copies.copy(path, folder / "theirs", copies.unlit)
        scene = render(copies.copy(path, folder / "ours", copies.unlit), folder)
        data = self.page.render(job(f"/models/copy/theirs/{plain.name}", scene, shift))
        if changes:
            view = scene.view
            scene = render(copies.copy(path, folder / "ours", copies.unlit, *changes), folder)
            scene = scene._replace(view=view)
        root, _ = copies.read(plain)
        return compare(scene, ours(scene), theirs(data), image_tolerance(root))

    def check(self, path: Path, share: float = SHARE) -> None:
        with self.subTest(model=label(path)):
            try:
                found = self.compared(path)
            except FileNotFoundError as error:
                print(f"skipped: {label(path)}: {error}")
                return
            print(f"three.js: {label(path)}: {found.summary}")
            self.assertEqual(found.faults, [])
            self.assertGreater(found.share, share, "too few pixels are compared")

    def test_own_models(self) -> None:
        for path in self.own:
            self.check(path)

    def test_public_models(self) -> None:
        for path in public_models():
            if "validator-negative" not in path.parts and copies.has_triangles(path):
                self.check(path, share=0.0)

    def test_faults_are_found(self) -> None:
        """Each fault is made in the model that we render, or in the camera of three.js."""
        faults: List[Tuple[str, str, Sequence[copies.Change], str]] = [
            ("nearest.gltf", "flipped v", [flipped_v], "uv color"),
            ("texture_transform.gltf", "flipped v", [flipped_v], "uv color"),
            ("camera.gltf", "a transposed matrix", [transposed], "normal uv distance color"),
            ("hierarchy.gltf", "a scale without its sign", [unmirrored], "normal distance"),
            ("hierarchy.gltf", "no factor", [without_factor], "color"),
            ("vertex_colors.glb", "no factor", [without_factor], "color"),
            ("vertex_colors.glb", "no vertex colours", [without_colors], "color"),
            ("texture_transform.gltf", "no transform of the texture", [without_transform], "color"),
            ("texture_rotation.gltf", "turned the other way", [turned], "color"),
            ("second_set.gltf", "set 0 instead of set 1", [first_set], "uv color"),
            ("wraps.gltf", "repeated instead of clamped and mirrored", [repeated], "color"),
        ]
        for name, what, changes, differing in faults:
            with self.subTest(fault=what, model=name):
                found = self.compared(self.folder / "own" / name, *changes)
                for part in differing.split():
                    self.assertTrue(any(fault.startswith(part) for fault in found.faults), (part, found.faults))
        for shift in (0.5, 0.05):
            with self.subTest(fault=f"{shift} pixels to the right"):
                found = self.compared(self.folder / "own" / "hierarchy.gltf", shift=shift)
                for part in ("normal", "uv", "distance"):
                    self.assertTrue(any(fault.startswith(part) for fault in found.faults), found.faults)


def flipped_v(root: Json) -> None:
    """Texture coordinates with v up, and the image as it is."""
    for mesh in root["meshes"]:
        for primitive in mesh["primitives"]:
            accessor = primitive["attributes"]["TEXCOORD_0"]
            copies.change_numbers(root, accessor, lambda column, value: 1 - value if column else value)


def without_factor(root: Json) -> None:
    for material in root["materials"]:
        del material["pbrMetallicRoughness"]["baseColorFactor"]


def without_colors(root: Json) -> None:
    for mesh in root["meshes"]:
        for primitive in mesh["primitives"]:
            del primitive["attributes"]["COLOR_0"]


def base_textures(root: Json) -> List[Json]:
    return [material["pbrMetallicRoughness"]["baseColorTexture"] for material in root["materials"]]


def without_transform(root: Json) -> None:
    for texture in base_textures(root):
        del texture["extensions"]


def turned(root: Json) -> None:
    for texture in base_textures(root):
        transform = texture["extensions"]["KHR_texture_transform"]
        transform["rotation"] = -transform["rotation"]


def first_set(root: Json) -> None:
    for texture in base_textures(root):
        texture.pop("texCoord", None)


def repeated(root: Json) -> None:
    for sampler in root["samplers"]:
        sampler.pop("wrapS", None)
        sampler.pop("wrapT", None)


if __name__ == "__main__":
    unittest.main()
