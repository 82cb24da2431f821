"""Runs the program `povray` as a child process."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from typing import List

from . import checks, halves
from .errors import DriverError, Unsupported

# Time limit of one rendering in seconds. The harness has its own limit.
_LIMIT = 3600


def program() -> str:
    """The path of the program: `WHITSTONE_POVRAY`, otherwise the one on the search path."""
    named = os.environ.get("WHITSTONE_POVRAY")
    found = shutil.which(named or "povray")
    if found is None:
        raise DriverError(f"the program {named or 'povray'} was not found; install POV-Ray (Debian: `apt-get install povray`) or set WHITSTONE_POVRAY to its path")
    return found


def version() -> str:
    """The version, such as 3.7.0.10."""
    said = subprocess.run([program(), "--version"], capture_output=True, text=True, timeout=60, check=False)
    match = re.search(r"POV-Ray (\d+\.\d+[\w.]*)", said.stdout + said.stderr)
    if match is None:
        raise DriverError(f"povray does not report its version: {(said.stdout + said.stderr).strip()[-500:]}")
    found = match.group(1)
    if not found.startswith("3.7"):
        raise DriverError(f"expected POV-Ray 3.7, found {found}")
    return found


def render(scene: str, width: int, height: int, window: halves.Window) -> List[List[halves.Color]]:
    """Rows of colours inside a window of the image, top row first."""
    with tempfile.TemporaryDirectory(prefix="whitstone-povray-") as folder:
        with open(os.path.join(folder, "scene.pov"), "w", encoding="utf-8") as file:
            file.write(scene)
        left, top, right, bottom = window
        command = [program(), "+Iscene.pov", "+Oimage.exr", "+FE", f"+W{width}", f"+H{height}", "-D", "-A", "-V", "-P", "+WT1", "-GD", "-GR", "-GS", "-GW"]
        command += ["File_Gamma=1.0", "Output_Alpha=off", "Quality=9"]
        if window != (0, 0, width, height):
            # Counted from 1, both ends included.
            command += [f"+SC{left + 1}", f"+SR{top + 1}", f"+EC{right}", f"+ER{bottom}"]
        # Ignore the user's own settings.
        environment = {key: value for key, value in os.environ.items() if key != "POVINI"}
        environment.update(HOME=folder, LC_ALL="C")
        try:
            done = subprocess.run(
                command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, timeout=_LIMIT, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise DriverError(f"povray: {error}") from error
        said = (done.stdout + done.stderr).decode("utf-8", "replace")
        path = os.path.join(folder, "image.exr")
        mark = re.search(checks.MARK + r"\d+", said) if done.returncode != 0 else None
        if mark is not None:
            # The number refers to a comment in the scene.
            raise Unsupported(scene.split(f"// {mark.group()}: ", 1)[1].split("\n", 1)[0])
        if done.returncode != 0 or not os.path.isfile(path):
            raise DriverError(f"povray exited with {done.returncode}: {_problem(said)}")
        return halves.read(path, window)


def _problem(said: str) -> str:
    """The part of POV-Ray's output that describes the error."""
    at = said.find("Parse Error")
    start = said.rfind("File '", 0, at) if at >= 0 else -1
    return said[max(start, 0) :].strip()[-1500:] if at >= 0 else said.strip()[-1500:]
