"""The oracle."""

from pathlib import Path

import numpy as np
import pytest

import whitstone
import whitstone.oracle

SCENES = Path(__file__).resolve().parents[3] / "scenes"


def test_the_oracle_agrees_with_the_tracer():
    scene = whitstone.Scene(SCENES / "showcase" / "classic.toml")
    random = np.random.default_rng(1)
    origins = random.normal(size=(300, 3)) + [0, 2, 0]
    directions = random.normal(size=(300, 3))
    exact = whitstone.oracle.trace(scene, origins, directions)
    found = scene.trace(origins, directions)
    assert exact.certain.all() and np.isfinite(exact.t).sum() > 100
    np.testing.assert_array_equal(np.isfinite(found.t), np.isfinite(exact.t))
    hit = np.isfinite(exact.t)
    np.testing.assert_allclose(found.t[hit], exact.t[hit], rtol=1e-12)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(exact.point[hit], (origins + found.t[:, None].clip(max=1e9) * unit)[hit], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(exact.normal[hit], axis=1), 1.0)
    assert np.isnan(exact.point[~hit]).all()


def test_a_wrong_tracer_is_found():
    scene = whitstone.Scene(SCENES / "shapes" / "sphere.toml")
    oracle = whitstone.oracle.Oracle(scene.with_({"shape.0.radius": 0.999}))
    origins, directions = np.tile([0.0, 0.0, 4.0], (5, 1)), np.tile([0.0, 0.0, -1.0], (5, 1))
    assert (np.abs(oracle.trace(origins, directions).t - scene.trace(origins, directions).t) > 1e-4).all()


def test_pixels():
    scene = whitstone.Scene(SCENES / "showcase" / "classic.toml")
    oracle = whitstone.oracle.Oracle(scene)
    value, error = oracle.pixel(40, 30)
    np.testing.assert_allclose(scene.pixel(40, 30), value, rtol=1e-9)
    assert max(error) < 1e-9
    with pytest.raises(KeyError):
        oracle.pixel(4000, 0)


def test_what_it_does_not_support_is_named():
    camera = {"type": "perspective", "look_at": {"origin": [0, 0, 4], "target": [0, 0, 0]}}
    terrain = {"type": "heightfield", "columns": 400, "rows": 400}
    with pytest.raises(whitstone.SceneError, match="oracle does not support a height field"):
        whitstone.oracle.Oracle({"camera": camera, "shape": [terrain]})


def test_progress_and_bad_rays():
    oracle = whitstone.oracle.Oracle(SCENES / "shapes" / "sphere.toml")
    seen = []
    oracle.trace(np.zeros((50, 3)), np.ones((50, 3)), progress=lambda done, total: seen.append((done, total)))
    assert seen and seen[-1][1] == 50
    with pytest.raises(ValueError, match="ray 1"):
        oracle.trace([[0, 0, 0], [0, 0, np.nan]], [[1, 0, 0]] * 2)
    with pytest.raises(ValueError, match="shape"):
        oracle.trace([[0, 0]], [[1, 0]])
