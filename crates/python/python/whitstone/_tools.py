"""The commands as functions. Each runs the command line in a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from typing import Any, Dict, Iterator, List, Optional, Sequence, Union

from ._scene import Scene, Source


class CommandError(RuntimeError):
    """A command could not do its work. The text is what it printed."""

    def __init__(self, text: str, exit_code: int) -> None:
        super().__init__(text)
        #: 2: an input is wrong; 3: something that the command needs is missing.
        self.exit_code = exit_code


class Validation:
    """The results of :func:`validate`."""

    def __init__(self, results: Dict[str, Any], text: str, report: str) -> None:
        #: Everything, as ``whitstone validate --json`` writes it.
        self.results = results
        #: What the command printed.
        self.text = text
        #: The path of the report, an HTML page.
        self.report = report

    @property
    def passed(self) -> bool:
        """Whether every scene passes or is confirmed by the oracle."""
        summary = self.results["summary"]
        return bool(summary["cases"] > 0 and summary["failed"] == 0 and summary["undecided"] == 0)

    @property
    def cases(self) -> List[Dict[str, Any]]:
        """The result of each scene."""
        return list(self.results["results"])

    def __bool__(self) -> bool:
        return self.passed

    def __repr__(self) -> str:
        verdicts = ", ".join(f"{case['scene']}: {case['status']}" for case in self.cases)
        return f"<whitstone.Validation {verdicts}>"


@contextlib.contextmanager
def _file(scene: Union[Source, Scene]) -> Iterator[List[str]]:
    """The arguments that name a scene."""
    if not isinstance(scene, Scene):
        if isinstance(scene, (str, os.PathLike)) and os.path.exists(scene):
            yield [os.fspath(scene)]
            return
        scene = Scene(scene)
    changes = [argument for change in scene.overrides for argument in ("--set", change)]
    if scene.is_file:
        yield [os.fspath(scene.source), *changes, *(["--camera", scene.camera] if scene.camera is not None else [])]
        return
    # In the folder that the paths of the scene are relative to.
    handle, path = tempfile.mkstemp(prefix=".whitstone-", suffix=".toml", dir=scene.base)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(str(scene.source))
        yield [path, *changes]
    finally:
        os.unlink(path)


@contextlib.contextmanager
def _scene_file(scene: Union[Source, Scene]) -> Iterator[List[str]]:
    """Like :func:`_file`, for a command that takes no camera."""
    with contextlib.ExitStack() as stack:
        arguments = stack.enter_context(_file(scene))
        if "--camera" in arguments:
            # The scene with that camera alone, in a file of its own.
            name = os.path.splitext(os.path.basename(arguments[0]))[0]
            path = os.path.join(stack.enter_context(tempfile.TemporaryDirectory()), f"{name}.toml")
            done = _run(["convert", *arguments, path])
            if done.returncode != 0:
                raise CommandError(done.stdout.strip(), done.returncode)
            arguments = [path]
        yield arguments


def _run(arguments: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    """Runs a command. Ctrl-C ends it too."""
    command = [sys.executable, "-m", "whitstone", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, encoding="utf-8") as process:
        try:
            text, _ = process.communicate()
        except BaseException:
            process.send_signal(signal.SIGTERM)
            process.communicate()
            raise
    return subprocess.CompletedProcess(command, process.returncode, text, "")


def _json(arguments: Sequence[str], expected: Sequence[int] = (0,)) -> "tuple[Any, str]":
    """The JSON that a command writes, and what it prints."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "result.json")
        done = _run([*arguments, "--json", path])
        if done.returncode not in expected or not os.path.exists(path):
            raise CommandError(done.stdout.strip(), done.returncode)
        with open(path, encoding="utf-8") as file:
            return json.load(file), done.stdout


def explain(scene: Union[Source, Scene]) -> Dict[str, Any]:
    """What Whitstone builds for a scene, and what it leaves out."""
    with _file(scene) as arguments:
        found, _ = _json(["explain", *arguments])
    assert isinstance(found, dict)
    return found


def convert(scene: Union[Source, Scene], output: Union[str, "os.PathLike[str]"], *, strict: bool = False) -> Dict[str, Any]:
    """Writes a scene in another format, and returns what was kept, approximated and dropped."""
    with _file(scene) as arguments:
        found, _ = _json(["convert", *arguments, os.fspath(output), *(["--strict"] if strict else [])])
    assert isinstance(found, dict)
    return found


def validate(
    *scenes: Union[Source, Scene],
    reference: str = "auto",
    target: Optional[Union[str, "os.PathLike[str]"]] = None,
    mitsuba: Optional[Union[str, "os.PathLike[str]"]] = None,
    oracle: bool = False,
) -> Validation:
    """Compares images of scenes with those of a reference renderer, and writes a report.

    ``reference``, ``target``, ``mitsuba`` and ``oracle`` are the options of ``whitstone validate``.
    If Mitsuba is installed in this Python (``pip install whitstone[mitsuba]``), it is used.
    """
    if mitsuba is None:
        import importlib.util

        if importlib.util.find_spec("mitsuba") is not None:
            mitsuba = sys.executable
    folder = os.fspath(target) if target is not None else os.path.join("target", "whitstone")
    options = ["--reference", reference]
    options += ["--target", folder] if target is not None else []
    options += ["--mitsuba", os.fspath(mitsuba)] if mitsuba is not None else []
    options += ["--oracle"] if oracle else []
    with contextlib.ExitStack() as stack:
        named = [stack.enter_context(_scene_file(scene)) for scene in scenes]
        changes = {tuple(arguments[1:]) for arguments in named}
        if len(changes) > 1:
            raise ValueError("scenes with different changes cannot be validated by one call")
        paths = [arguments[0] for arguments in named]
        found, text = _json(["validate", *paths, *(changes.pop() if changes else ()), *options], expected=(0, 1))
    return Validation(found, text, os.path.join(folder, "validate", "index.html"))
