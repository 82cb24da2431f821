"""Base colours, normals and texture coordinates, compared pixel by pixel with three.js."""

import unittest
from pathlib import Path
from typing import Any, Dict, List, NamedTuple

import browser
import copies
from support import HEIGHT, MODULES, WIDTH, Case, Json, Scene, label, public_models, render

try:
    import numpy as np
    from rays import differences, same_around
except ImportError as missing:
    raise unittest.SkipTest(f"{missing.name} is not installed") from None

# three.js renders this number of pixels per pixel along each axis; the middle one is compared.
# SwiftShader snaps vertices to 1/16 of its pixels, which moves values by up to 1/32 of them.
FACTOR = 5
# Largest difference, in pixels: the value may be that of a point so far away.
MOVED = 1 / 32 / FACTOR * 2
# Errors of single precision in shaders, for values of about 1.
ROUNDING = 2e-5
# Textures have 8 bits, and SwiftShader filters with weights of 8 bits.
FILTERED = 1.5 / 256
# Decoders of JPEG differ by up to three codes; where sRGB is steepest a code is 2.3/255.
JPEG = 3 * 2.3 / 255
# A pixel is compared where each value differs by less than this from the mean of opposite
# neighbours: other pixels see an edge.
SMOOTH = {"normal": 0.02, "uv": 0.02}
# At least this part of the pixels that see a surface must be compared.
SHARE = 0.25


class Images(NamedTuple):
    """Colour, coverage, normal, distance and texture coordinates, top row first."""

    color: Any
    covered: Any
    normal: Any
    distance: Any
    uv: Any


def ours(scene: Scene) -> Images:
    channels = scene.channels

    def stack(*names: str) -> Any:
        return np.stack([channels[name] for name in names], axis=-1)

    covered = channels["shape_id.I"] >= 0
    normal = stack("normal.X", "normal.Y", "normal.Z")
    return Images(stack("R", "G", "B"), covered, normal, channels["depth.Z"], stack("uv.U", "uv.V"))


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
        "camera": camera,
        "shapes": shapes,
    }


def theirs(data: bytes) -> Images:
    passes = np.frombuffer(data, "<f4").reshape(3, HEIGHT, WIDTH, 4)[:, ::-1].astype(float)
    color, normal, uv = passes
    # Theirs has v down.
    coordinates = np.stack([uv[..., 0], 1 - uv[..., 1]], axis=-1)
    return Images(color[..., :3], color[..., 3] > 0, normal[..., :3], normal[..., 3], coordinates)


class Comparison(NamedTuple):
    """What differs, and a summary."""

    faults: List[str]
    summary: str


def compare(scene: Scene, mine: Images, other: Images, image: float) -> Comparison:
    """Compares all pixels away from edges. `image`: tolerance of colours from images."""
    faults = []
    whole = same_around(scene.channels["shape_id.I"]) & same_around(scene.channels["primitive_id.I"])
    same = same_around(scene.channels["shape_id.I"])
    seen = mine.covered
    if not seen.any():
        faults.append("nothing is seen")
    wrong = same & (mine.covered != other.covered)
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
    colors = inside
    if scene.nearest:
        # Which texel is nearest depends on rounding at the border of texels.
        colors = inside & (slopes["color"] < 1e-3)
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
        excess = np.where(mask, error / allowed, 0)
        row, column = np.unravel_index(int(excess.argmax()), excess.shape)
        worst.append(f"{name} {error[row, column]:.1e} of {allowed[row, column]:.1e} at ({column}, {row})")
        beyond = excess > 1
        if beyond.any():
            values = f"ours {first[row, column]}, theirs {second[row, column]}"
            faults.append(f"{name}: {int(beyond.sum())} pixels, worst {worst[-1]}: {values}")
    share = int(inside.sum()) / max(int(seen.sum()), 1)
    of_colors = int(colors.sum()) / max(int(seen.sum()), 1)
    if share < SHARE or of_colors < SHARE:
        faults.append(f"only {share:.0%} of the pixels are compared, {of_colors:.0%} of the colours")
    pixels = f"{share:.0%} of {int(seen.sum())} pixels"
    if colors is not inside:
        pixels += f" ({of_colors:.0%} of the colours)"
    return Comparison(faults, f"{pixels}, {', '.join(worst)}")


def image_tolerance(root: Json) -> float:
    """The tolerance of colours: that of images, or of the shader where there are none."""
    images = root.get("images", [])
    if not images:
        return ROUNDING
    jpeg = any("jp" in (image.get("mimeType", "") + image.get("uri", "")[-5:]) for image in images)
    return FILTERED + (JPEG if jpeg else 0)


class ThreeTest(Case):
    page: browser.Browser

    @classmethod
    def setUpClass(cls) -> None:
        chromium = browser.program()
        if chromium is None:
            raise unittest.SkipTest("Chromium is not installed")
        if not (MODULES / "three").is_dir():
            raise unittest.SkipTest("three.js is not installed")
        super().setUpClass()
        cls.page = browser.Browser(chromium, MODULES, cls.folder)
        cls.addClassCleanup(cls.page.close)

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

    def check(self, path: Path) -> None:
        with self.subTest(model=label(path)):
            try:
                found = self.compared(path)
            except FileNotFoundError as error:
                print(f"skipped: {label(path)}: {error}")
                return
            print(f"three.js: {label(path)}: {found.summary}")
            self.assertEqual(found.faults, [])

    def test_own_models(self) -> None:
        for path in self.own:
            self.check(path)

    def test_public_models(self) -> None:
        for path in public_models():
            if "validator-negative" not in path.parts and copies.has_triangles(path):
                self.check(path)


if __name__ == "__main__":
    unittest.main()
