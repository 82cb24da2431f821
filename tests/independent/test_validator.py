"""Which files are valid: what gltf-validator says, and what we do with the file."""

import contextlib
import io
import json
import shutil
import subprocess
import unittest
from collections import Counter
from pathlib import Path
from typing import Any, List, NamedTuple

import copies
import damage
from support import MODULES, Case, Run, label, public_models, size, skip, whitstone

HERE = Path(__file__).resolve().parent
# Limits of a small file: memory, and processor time that no machine needs unless the work is
# without bounds. A large file may take a second more per MiB and per 250,000 triangles.
SECONDS, MEBIBYTES = 10.0, 256.0

# What the validator calls valid with a warning, and what it does not read, may be refused: wrong
# values of lists, images of other kinds, incomplete triangles, extensions; damaged pixels.
WARNED = {
    "VALUE_NOT_IN_LIST",
    "IMAGE_UNRECOGNIZED_FORMAT",
    "MESH_PRIMITIVE_INCOMPATIBLE_MODE",
    "UNSUPPORTED_EXTENSION",
}
UNREAD = "cannot be used as a texture: /images/0: damaged"
# Faults that are not corrected yet; each has a test below, which says when it is.
OPEN = ["expected unit", "expected struct Void"]


class Found(NamedTuple):
    """What the validator says of a file, and how our run ended."""

    path: Path
    report: Any
    run: Run


class ValidatorTest(Case):
    @classmethod
    def setUpClass(cls) -> None:
        if shutil.which("node") is None:
            raise skip("node is not installed")
        if not (MODULES / "gltf-validator").is_dir():
            raise skip("gltf-validator is not installed")
        super().setUpClass()

    def found(self, paths: List[Path]) -> List[Found]:
        """Validates and renders files."""
        given = json.dumps([str(path) for path in paths])
        command = ["node", str(HERE / "validate.cjs"), str(MODULES)]
        reports = json.loads(subprocess.run(command, input=given, capture_output=True, text=True, check=True).stdout)
        return [Found(path, report, self.run_on(path)) for path, report in zip(paths, reports)]

    def run_on(self, path: Path) -> Run:
        image = self.folder / "image.exr"
        run = Run(0, 0.0, 0.0, "")
        image.unlink(missing_ok=True)
        run = whitstone("render", str(path), "-o", str(image), *size(64, 48))
        if run.code == 0:
            self.assertTrue(image.is_file(), path)
        return run

    def seconds(self, path: Path, report: Any) -> float:
        """The processor time that a file may take."""
        whole = sum(file.stat().st_size for file in path.parent.iterdir() if file.is_file())
        bytes_read = path.stat().st_size if self.folder in path.parents else whole
        return SECONDS + bytes_read / 2**20 + report.get("triangles", 0) / 250_000

    def check(self, paths: List[Path], what: str, quiet: bool = False) -> "Counter[str]":
        """Checks all files; counts them by what the validator says and how our run ended."""
        counts: "Counter[str]" = Counter()
        slowest, largest = 0.0, 0.0
        for path, report, run in self.found(paths):
            with self.subTest(model=label(path), report=report):
                errors = report.get("errors", -1)
                # What an import approximates is printed before an error.
                lines = run.messages.strip().split("\n")
                first = next((k for k, line in enumerate(lines) if line.startswith("error: ")), 0)
                told = " ".join(lines[first:])
                slowest, largest = max(slowest, run.seconds), max(largest, run.mebibytes)
                self.assertIn(run.code, (0, 2), f"ended with {run.code}: {told}")
                self.assertLess(run.seconds, self.seconds(path, report), "too slow")
                self.assertLess(run.mebibytes, MEBIBYTES, "too large")
                if run.code == 2:
                    self.assertTrue(told.startswith("error: "), told)
                    self.assertIn(path.name, told)
                    self.assertGreater(len(told), len(f"error: {path}") + 8, told)
                if errors == 0 and run.code and report["triangles"] and copies.shows_triangles(path):
                    warned = WARNED.intersection(report["codes"]) or UNREAD in told
                    known = any(text in told for text in OPEN)
                    self.assertTrue(warned or known, f"valid, but: {told}")
                    if known:
                        print(f"validator: {label(path)}: valid, but still refused: {told}")
                ending = "rendered" if run.code == 0 else "refused"
                counts[("valid" if errors == 0 else "invalid") + ", " + ending] += 1
                if errors != 0 and run.code == 0 and not quiet:
                    print(f"validator: {label(path)}: loaded although {report.get('first') or report.get('refused')}")
        print(f"validator: {what}: {dict(counts)}, at most {slowest:.2f} s and {largest:.0f} MiB")
        return counts

    def test_own_models(self) -> None:
        counts = self.check(self.own, "models")
        self.assertEqual(dict(counts), {"valid, rendered": len(self.own)})

    def test_damaged_documents(self) -> None:
        folder = self.folder / "documents"
        folder.mkdir()
        models = [model for model in self.own if model.stem != "external"]
        paths = [path for model in models for path in damage.documents(model, folder, 8)]
        counts = self.check(paths, "documents with a changed value", quiet=True)
        self.assertGreater(counts["invalid, refused"], len(paths) // 4)

    def test_damaged_containers(self) -> None:
        folder = self.folder / "containers"
        folder.mkdir()
        paths = damage.containers(self.folder / "own" / "quantized.glb", folder, 90)
        counts = self.check(paths, "damaged .glb", quiet=True)
        self.assertGreater(counts["invalid, refused"], len(paths) // 4)

    def test_damaged_data(self) -> None:
        folder = self.folder / "data"
        folder.mkdir()
        names = ["sparse.gltf", "skin.gltf", "morph.gltf", "strip.gltf", "instancing.gltf"]
        paths = [path for name in names for path in damage.buffers(self.folder / "own" / name, folder, 15)]
        self.check(paths, "models with damaged data", quiet=True)

    def test_public_models(self) -> None:
        paths = public_models()
        if paths:
            self.check(paths, "public models")

    def valid(self, name: str, change: copies.Change) -> None:
        """A changed copy of a model must be valid and rendered."""
        path = copies.copy(self.folder / "own" / name, self.folder / "valid", change)
        ((_, report, run),) = self.found([path])
        self.assertEqual(report.get("errors"), 0, report)
        self.assertEqual(run.code, 0, run.messages)

    def test_a_second_scene_without_nodes(self) -> None:
        self.valid("hierarchy.gltf", lambda root: root["scenes"].append({"name": "empty"}))

    def test_a_texture_without_source(self) -> None:
        self.valid("hierarchy.gltf", lambda root: root["textures"][0].clear())

    def test_extras_that_are_no_object(self) -> None:
        self.valid("flat.gltf", lambda root: root["nodes"][0].update(extras=[1, "text"]))

    def bounded(self, name: str, change: copies.Change, width: int = 64) -> None:
        """A small file that stands for many things must be rendered or refused within the limits."""
        path = copies.copy(self.folder / "own" / name, self.folder / "large", change)
        out = str(self.folder / "large.exr")
        run = whitstone("render", str(path), "-o", out, *size(width, width * 3 // 4))
        self.assertIn(run.code, (0, 2), run.messages)
        self.assertLess(run.seconds, SECONDS)
        self.assertLess(run.mebibytes, MEBIBYTES)

    def test_instances_in_one_place(self) -> None:
        # Every ray meets all of them.
        self.bounded("instancing.gltf", lambda root: instances(root, 4000), width=16)

    def test_too_many_instances(self) -> None:
        self.bounded("instancing.gltf", lambda root: instances(root, 20_000_000))

    def test_too_many_vertices(self) -> None:
        self.bounded("flat.gltf", lambda root: root["accessors"][0].update(count=2**31 - 1))

    def test_nodes_shared_and_in_cycles(self) -> None:
        self.bounded("flat.gltf", lambda root: root["nodes"][0].update(children=[0]))
        self.bounded("flat.gltf", nested)

    def test_no_scenes(self) -> None:
        """All nodes are shown."""
        self.valid("flat.gltf", without_scenes)

    def test_faults_are_found(self) -> None:
        """A valid file that is refused, and runs that end otherwise, are reported."""
        path = self.folder / "own" / "hierarchy.gltf"
        good = {"errors": 0, "codes": [], "triangles": 6}

        def faults(report: Any, run: Run) -> int:
            result = unittest.TestResult()
            case = Replay(Found(path, report, run))
            case.folder = self.folder
            case.run(result)
            return len(result.failures) + len(result.errors)

        told = f"error: {path}: this is not read"
        self.assertEqual(faults(good, Run(0, 0.1, 20.0, "")), 0)
        self.assertEqual(faults({"errors": 1}, Run(2, 0.1, 20.0, told)), 0)
        wrong = {
            "valid, but refused": (good, Run(2, 0.1, 20.0, told)),
            "no message": ({"errors": 1}, Run(2, 0.1, 20.0, "error: hierarchy.gltf")),
            "a panic": ({"errors": 1}, Run(101, 0.1, 20.0, told)),
            "a signal": ({"errors": 1}, Run(-6, 0.1, 20.0, told)),
            "too slow": (good, Run(0, 50.0, 20.0, "")),
            "too large": (good, Run(0, 0.1, 300.0, "")),
        }
        for what, (report, run) in wrong.items():
            with self.subTest(fault=what):
                self.assertGreater(faults(report, run), 0)


def without_scenes(root: copies.Json) -> None:
    del root["scene"], root["scenes"]


def instances(root: copies.Json, count: int) -> None:
    """Instances whose translations are all zero, without data."""
    root["accessors"].append({"componentType": 5126, "count": count, "type": "VEC3"})
    extension = root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]
    extension["attributes"] = {"TRANSLATION": len(root["accessors"]) - 1}


def nested(root: copies.Json) -> None:
    """Each of 40 nodes has the one before it twice."""
    for _ in range(40):
        last = len(root["nodes"]) - 1
        root["nodes"].append({"children": [last, last]})
    root["scenes"][0]["nodes"] = [len(root["nodes"]) - 1]


class Replay(ValidatorTest):
    """The check of one run that did not happen."""

    def __init__(self, run: Found) -> None:
        super().__init__("replay")
        self.given = run

    def found(self, paths: List[Path]) -> List[Found]:
        return [self.given]

    def replay(self) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            self.check([self.given.path], "replay")


def load_tests(loader: unittest.TestLoader, tests: unittest.TestSuite, pattern: Any) -> unittest.TestSuite:
    """`Replay` is no test of its own."""
    return unittest.TestSuite([loader.loadTestsFromTestCase(ValidatorTest)])


if __name__ == "__main__":
    unittest.main()
