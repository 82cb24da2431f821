"""The commands as functions."""

import base64
import json
import struct
import subprocess
import sys
from pathlib import Path

import pytest

import whitstone
from whitstone import _tools

SCENES = Path(__file__).resolve().parents[3] / "scenes"
SPHERE = SCENES / "shapes" / "sphere.toml"


def test_explain():
    found = whitstone.explain(SPHERE)
    assert found["accelerator"]
    changed = whitstone.explain(whitstone.Scene(SPHERE).with_({"accelerator": {"type": "kdtree"}}))
    assert "kdtree" in str(changed["accelerator"])


def test_convert(tmp_path):
    notes = whitstone.convert(SPHERE, tmp_path / "sphere.xml")
    assert (tmp_path / "sphere.xml").read_text().startswith("<")
    assert notes
    camera = {"type": "perspective", "look_at": {"origin": [0, 0, 4], "target": [0, 0, 0]}}
    scene = {"camera": camera, "shape": [{"type": "sphere"}]}
    whitstone.convert(scene, tmp_path / "of_a_dictionary.glb")
    assert (tmp_path / "of_a_dictionary.glb").stat().st_size > 0
    assert list(Path(".").glob(".whitstone-*")) == []


def two_cameras(path):
    """A triangle in front of a perspective and of an orthographic camera, as glTF."""
    corners = struct.pack("<9f", -1, -1, 0, 1, -1, 0, 0, 1, 0)
    uri = "data:application/octet-stream;base64," + base64.b64encode(corners).decode()
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0]}
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0}, *({"camera": camera, "translation": [0, 0, 4]} for camera in (0, 1))],
        "cameras": [
            {"name": "near", "type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}},
            {"name": "flat", "type": "orthographic", "orthographic": {"xmag": 2, "ymag": 2, "znear": 0, "zfar": 10}},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [accessor],
        "bufferViews": [{"buffer": 0, "byteLength": len(corners)}],
        "buffers": [{"byteLength": len(corners), "uri": uri}],
    }
    path.write_text(json.dumps(document))
    return path


def test_the_camera_of_a_scene_is_used(tmp_path):
    path = two_cameras(tmp_path / "triangle.gltf")
    small = {"film.width": 16, "film.height": 16}
    near, flat = (whitstone.Scene(path, small, camera=name) for name in ("near", "flat"))
    assert (near.render().rgb != flat.render().rgb).any()
    assert [whitstone.explain(scene)["camera"] for scene in (near, flat)] == ["perspective", "orthographic"]
    # `validate` has no such option: it gets the scene with that camera alone.
    for scene in (near, flat):
        with _tools._scene_file(scene) as (converted,):
            assert (whitstone.Scene(converted).render().rgb == scene.render().rgb).all()


def test_errors_are_those_of_the_command(tmp_path):
    with pytest.raises(whitstone.CommandError, match="gif") as caught:
        whitstone.convert(SPHERE, tmp_path / "a.gif")
    assert caught.value.exit_code == 2
    # A scene that is not there is an error of the scene.
    with pytest.raises(whitstone.SceneError, match="nowhere"):
        whitstone.convert("nowhere.toml", tmp_path / "a.xml")


def test_the_command():
    done = subprocess.run([sys.executable, "-m", "whitstone", "list", "shapes"], capture_output=True, text=True)
    assert done.returncode == 0 and "superquadric" not in done.stdout and "sphere" in done.stdout
    done = subprocess.run([sys.executable, "-m", "whitstone", "render", "nowhere.toml"], capture_output=True, text=True)
    assert done.returncode == 2 and "nowhere.toml" in done.stderr


def test_validate(tmp_path, monkeypatch):
    monkeypatch.chdir(SCENES.parent)
    good = whitstone.validate("scenes/shapes/sphere.toml", reference="stored", target=tmp_path)
    assert good and good.passed and good.cases[0]["status"] == "pass"
    assert Path(good.report).is_file()
