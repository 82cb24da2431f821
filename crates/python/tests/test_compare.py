"""Comparison of images, in calls and in pytest."""

import subprocess
import sys
import textwrap

import numpy as np
import pytest

import whitstone
from whitstone.testing import assert_image_matches


def noise(shape=(24, 32, 3), seed=1):
    return np.random.default_rng(seed).random(shape)


def test_numbers():
    ours = noise()
    reference = ours.copy()
    reference[3, 4] += 0.5
    found = whitstone.compare(ours, reference, perceptual=True)
    assert found.rmse == pytest.approx(np.sqrt(np.mean((np.float32(ours) - np.float32(reference)).astype(float) ** 2)), rel=1e-6)
    assert found.pixels_over_tolerance == 1
    assert (found.worst[0]["x"], found.worst[0]["y"]) == (4, 3)
    assert found.max_abs == pytest.approx(0.5, rel=1e-5)
    assert 0 < found.flip < 1 and 0 < found.ssim < 1
    assert whitstone.compare(ours, ours).rmse == 0


def test_anything_that_holds_an_image(tmp_path):
    grey = noise((24, 32))
    image = whitstone.Image(grey)
    image.write(tmp_path / "a.exr")
    assert whitstone.compare(tmp_path / "a.exr", np.float32(grey)).rmse == 0
    with_alpha = np.concatenate([noise(), np.ones((24, 32, 1))], axis=2)
    assert whitstone.compare(with_alpha, noise()).rmse == 0


@pytest.mark.parametrize("shape", [(3,), (2, 2, 2), (2, 2, 5), (1, 2, 2, 3)])
def test_shapes_are_checked(shape):
    with pytest.raises(ValueError, match="shape"):
        whitstone.compare(np.zeros(shape), np.zeros(shape))


@pytest.mark.parametrize(
    "array, expected",
    [
        (np.zeros((2, 2, 3), np.uint8), "sRGB"),
        (np.zeros((2, 2, 3), complex), "complex128"),
        (np.zeros((2, 2, 3), bool), "bool"),
        (None, "object"),
    ],
)
def test_types_are_checked(array, expected):
    with pytest.raises(TypeError, match=expected):
        whitstone.compare(array, np.zeros((2, 2, 3)))


@pytest.mark.parametrize("layout", [np.asfortranarray, lambda a: a[::-1, ::-1][::-1, ::-1], lambda a: a.astype(">f8")])
def test_any_layout_of_memory(layout):
    ours, reference = noise(), noise(seed=2)
    assert whitstone.compare(layout(ours), layout(reference)).metrics == whitstone.compare(ours, reference).metrics


def test_other_sizes_and_nan_are_refused():
    with pytest.raises(ValueError, match="32"):
        whitstone.compare(noise(), noise((24, 33, 3)))
    bad = noise()
    bad[2, 5, 1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        whitstone.compare(bad, noise())


def test_assertions_bite():
    ours = noise()
    assert_image_matches(ours, ours * (1 + 1e-5))
    with pytest.raises(AssertionError, match="relative RMSE"):
        assert_image_matches(ours, ours * 1.01)
    moved = ours.copy()
    moved[0, 0] *= 1.005
    with pytest.raises(AssertionError, match="1 pixels are over tolerance"):
        assert_image_matches(moved, ours)
    assert_image_matches(moved, ours, max_pixels_over=1)
    bad = ours.copy()
    bad[2, 5, 1] = np.inf
    with pytest.raises(AssertionError, match=r"not finite, the first at \(5, 2\)"):
        assert_image_matches(bad, ours)
    with pytest.raises(AssertionError, match="33 x 24"):
        assert_image_matches(ours, noise((24, 33, 3)))


def test_pytest(tmp_path):
    (tmp_path / "test_it.py").write_text(
        textwrap.dedent(
            """
            import numpy as np, os
            from whitstone.testing import assert_image_matches

            def test_it():
                image = np.full((8, 8, 3), float(os.environ["LEVEL"]))
                assert_image_matches(image, "references/it.exr")
            """
        )
    )

    def run(level, *arguments):
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
        environment = {**__import__("os").environ, "LEVEL": level}
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        return done.returncode, done.stdout

    code, text = run("0.5")
    assert code == 1 and "--whitstone-accept" in text
    assert run("0.5", "--whitstone-accept")[0] == 0
    assert run("0.5")[0] == 0
    code, text = run("0.6", "--whitstone-report", "page.html")
    assert code == 1 and "relative RMSE" in text
    assert "references/it.exr" in (tmp_path / "page.html").read_text()
