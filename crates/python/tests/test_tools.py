"""The commands as functions."""

import subprocess
import sys
from pathlib import Path

import pytest

import whitstone

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
