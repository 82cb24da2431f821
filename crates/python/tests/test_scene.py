"""Scenes, images and rays."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import whitstone

SCENES = Path(__file__).resolve().parents[3] / "scenes"
CLASSIC = SCENES / "showcase" / "classic.toml"

BALL = {
    "film": {"width": 33, "height": 21, "aovs": ["depth", "shape_id"]},
    "camera": {"type": "perspective", "look_at": {"origin": [0, 0, 4], "target": [0, 0, 0]}},
    "light": [{"type": "ambient", "radiance": 1.0}, {"type": "point", "position": [2, 3, 4], "intensity": 20}],
    "shape": [{"type": "sphere"}],
}


def test_sources_are_equal(tmp_path):
    text = CLASSIC.read_text(encoding="utf-8")
    of_file = whitstone.render(CLASSIC)
    of_text = whitstone.Scene(text, base=CLASSIC.parent).render()
    np.testing.assert_array_equal(of_file.rgb, of_text.rgb)


def test_the_image_is_that_of_the_command(tmp_path):
    out = tmp_path / "classic.exr"
    subprocess.run([sys.executable, "-m", "whitstone", "render", str(CLASSIC), "-o", str(out)], check=True, capture_output=True)
    image, written = whitstone.render(CLASSIC), whitstone.Image.read(out)
    np.testing.assert_array_equal(image.rgb, written.rgb)
    assert image.layers.keys() == written.layers.keys() and image.layers
    for name, values in image.layers.items():
        np.testing.assert_array_equal(values, written.layers[name])


def test_changes():
    scene = whitstone.Scene(BALL)
    before = scene.render()
    smaller = scene.with_({"shape.0.radius": 0.5, "film.width": np.int64(40)})
    after = smaller.render()
    assert scene.size == (33, 21) and smaller.size == (40, 21)
    assert (before.layers["shape_id.I"] >= 0).sum() > 2 * (after.layers["shape_id.I"] >= 0).sum()
    # The first scene is as it was.
    np.testing.assert_array_equal(scene.render().rgb, before.rgb)


@pytest.mark.parametrize("sampler", ["center", "adaptive"])
def test_a_region_has_the_pixels_of_the_image(sampler):
    scene = whitstone.Scene({**BALL, "sampler": {"type": sampler}})
    whole = scene.render()
    for x, y, width, height in [(0, 0, 33, 21), (5, 3, 17, 9), (32, 20, 1, 1), (20, 0, 100, 100)]:
        part = scene.render(region=(x, y, width, height))
        np.testing.assert_array_equal(part.rgb, whole.rgb[y : y + height, x : x + width])
        np.testing.assert_array_equal(part.layers["depth.Z"], whole.layers["depth.Z"][y : y + height, x : x + width])
    assert scene.render(region=(40, 40, 2, 2)).rgb.shape == (0, 0, 3)


def test_a_pixel_is_that_of_the_image():
    scene = whitstone.Scene(BALL)
    image = scene.render()
    np.testing.assert_array_equal(np.float32(scene.pixel(16, 10)), image.rgb[10, 16])
    with pytest.raises(KeyError, match="outside"):
        scene.pixel(33, 0)


def test_all_problems_are_told():
    faulty = 'camera = { type = "perspective", fow = 30 }\nshape = [{ type = "spere" }]\n'
    with pytest.raises(whitstone.SceneError) as caught:
        whitstone.Scene(faulty)
    problems = caught.value.problems
    assert {(problem.line, problem.file) for problem in problems} == {(1, "scene"), (2, "scene")}
    assert all(problem.column > 1 for problem in problems)
    text = " ".join(f"{problem.message} {problem.help}" for problem in problems)
    assert "fov" in text and "sphere" in text
    with pytest.raises(whitstone.SceneError, match="nowhere.toml"):
        whitstone.Scene("nowhere.toml")


def test_ray_trees_are_limited():
    scene = {**BALL, "integrator": {"type": "whitted", "max_depth": 9}}
    scene["shape"] = [{"type": "sphere", "material": {"type": "dielectric", "interior_ior": 1.5}}]
    with pytest.raises(whitstone.SceneError, match="more than 4 rays.*max_tree_rays"):
        whitstone.Scene(scene, max_tree_rays=4).render()
    with pytest.raises(whitstone.SceneError, match="more than 4 rays"):
        whitstone.Scene(scene, max_tree_rays=4).with_({"film.width": 34}).pixel(16, 10)
    whole = whitstone.Scene(scene, max_tree_rays=1000).render()
    np.testing.assert_array_equal(whole.rgb, whitstone.render(scene).rgb)


def test_rays():
    scene = whitstone.Scene(BALL)
    origins = np.array([[0.0, 0, 4], [0, 0, 4], [0, 5, 0]])
    directions = np.array([[0.0, 0, -2], [0, 0, 1], [0, -1, 0]])
    hits = scene.trace(origins, directions)
    np.testing.assert_allclose(hits.t, [3, np.inf, 4], rtol=1e-15)
    np.testing.assert_array_equal(hits.shape, [0, -1, 0])
    assert hits.uv.shape == (3, 2)
    # Any layout of memory.
    again = scene.trace(np.asfortranarray(origins), directions.tolist())
    np.testing.assert_array_equal(again.t, hits.t)
    # More rays than one stream.
    many = scene.trace(np.repeat(origins, 1000, axis=0), np.repeat(directions, 1000, axis=0))
    np.testing.assert_array_equal(many.t, np.repeat(hits.t, 1000))
    assert len(scene.trace(np.zeros((0, 3)), np.zeros((0, 3))).t) == 0


@pytest.mark.parametrize(
    "origins, directions, expected",
    [
        (np.zeros((4, 2)), np.ones((4, 2)), r"\(4, 2\)"),
        (np.zeros(3), np.ones(3), r"\(3,\)"),
        (np.zeros((4, 3)), np.ones((5, 3)), "4 origins"),
        (np.zeros((2, 3)), np.array([[0, 0, 1], [0, 0, 0]]), "ray 1"),
        (np.full((1, 3), np.nan), np.ones((1, 3)), "ray 0"),
    ],
)
def test_rays_are_checked(origins, directions, expected):
    with pytest.raises(ValueError, match=expected):
        whitstone.Scene(BALL).trace(origins, directions)


@pytest.mark.parametrize("kind", [complex, "M8[s]", object])
def test_types_of_rays_are_checked(kind):
    with pytest.raises(TypeError, match=str(np.dtype(kind))[:8]):
        whitstone.Scene(BALL).trace(np.zeros((1, 3), kind), np.ones((1, 3)))


def test_errors_name_the_argument():
    scene = whitstone.Scene(BALL)
    calls = {
        "threads": lambda: scene.render(threads=-1),
        "region": lambda: scene.render(region=(0, -1, 4, 4)),
        "region of column": lambda: scene.render(region=(1, 2, 3)),
        "y": lambda: scene.pixel(0, -1),
        "max_memory": lambda: whitstone.Scene(BALL, max_memory=-1),
        "max_tree_rays": lambda: whitstone.Scene(BALL, max_tree_rays=-1),
    }
    for name, call in calls.items():
        with pytest.raises(ValueError, match=f"expected (a )?{name}.*at least 0, found"):
            call()


def test_progress():
    told = []
    whitstone.Scene(BALL).render(progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (33 * 21, 33 * 21)

    def stop(done, total):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        whitstone.Scene({**BALL, "film": {"width": 4000, "height": 4000}}).render(progress=stop)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_stops_a_rendering():
    code = (
        # A process in the background of a shell inherits that the signal is ignored.
        "import signal, whitstone\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"scene = whitstone.Scene({BALL!r}, {{'film.width': 8000, 'film.height': 8000, 'sampler.type': 'grid', 'sampler.samples_per_axis': 32}})\n"
        "print('ready', flush=True)\n"
        "try:\n    scene.render()\nexcept KeyboardInterrupt:\n    print('stopped')\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    text, _ = process.communicate(timeout=10)
    assert text == "stopped\n" and process.returncode == 0


def test_notebooks():
    scene = whitstone.Scene(BALL)
    assert scene._repr_png_()[:4] == b"\x89PNG"
    page = whitstone.compare(scene.render(), scene.with_({"shape.0.radius": 0.9}).render())._repr_html_()
    assert page.count("data:image/png;base64,") == 3 and "pixels over tolerance" in page


def test_files(tmp_path):
    image = whitstone.Scene(BALL).render()
    image.write(tmp_path / "a.exr")
    again = whitstone.Image.read(tmp_path / "a.exr")
    np.testing.assert_array_equal(again.rgb, image.rgb)
    np.testing.assert_array_equal(again.layers["depth.Z"], image.layers["depth.Z"])
    image.write(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(ValueError, match="exr"):
        image.write(tmp_path / "a.gif")
    with pytest.raises(OSError, match="none"):
        whitstone.Image.read(tmp_path / "none.exr")


def test_the_import_is_quick():
    code = "import time; t = time.perf_counter(); import whitstone, sys; print(time.perf_counter() - t, 'numpy' in sys.modules)"
    best = min(float(subprocess.check_output([sys.executable, "-c", code], text=True).split()[0]) for _ in range(3))
    assert "numpy" not in subprocess.check_output([sys.executable, "-c", code], text=True).split()[1]
    # Not a benchmark: NumPy alone would take longer.
    assert best < 0.5
