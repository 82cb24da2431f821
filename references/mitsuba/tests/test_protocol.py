"""Serve mode as a child process, and the command line."""

import json
import os
import subprocess
import sys
import tempfile
import time
import unittest

from support import DOWN, FLOOR, ROOT, film
from whitstone_protocol import serve

SCENE = film(4, 4) + DOWN + FLOOR + '[[light]]\ntype = "ambient"\nradiance = 1\n'


def run(*arguments, text="", **variables):
    environment = {**os.environ, "PYTHONPATH": ROOT, **variables}
    command = [sys.executable, "-m", "whitstone_mitsuba", *arguments]
    return subprocess.run(command, input=text, capture_output=True, text=True, env=environment, timeout=300, check=False)


def _runs(process):
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        with open(f"/proc/{process}/stat", encoding="ascii") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


class Serve(unittest.TestCase):
    def test_conversation(self):
        probe = {"op": "probe", "base": ".", "pixels": [[1, 2]], "settings": [{}]}
        requests = [
            json.dumps({"op": "hello"}),
            "{ this is not JSON",
            json.dumps(["no", "object"]),
            json.dumps({"op": "paint"}),
            json.dumps({"op": ["list"]}),
            json.dumps({**probe, "scene": SCENE}),
            json.dumps({**probe, "scene": "[camera"}),
            json.dumps({**probe, "scene": SCENE + '[[shape]]\ntype = "sphere"\nradius = -1\ncolour = 2\n'}),
            json.dumps({**probe, "scene": SCENE + '[[shape]]\ntype = "gyroid"\n'}),
            json.dumps({**probe, "scene": SCENE, "pixels": [[4, 0]]}),
            json.dumps({**probe, "scene": SCENE, "settings": [{"q": 1}]}),
            json.dumps({"op": "render", "scene": SCENE, "base": ".", "out": "/nowhere/at/all.exr"}),
            json.dumps({"op": "tree", "scene": film() + DOWN, "base": ".", "pixel": [0, 0]}),
        ]
        child = run("serve", text="\n".join(requests) + "\n")
        self.assertEqual(child.returncode, 0, child.stderr)
        answers = [json.loads(line) for line in child.stdout.splitlines()]
        self.assertEqual(len(answers), len(requests))
        hello = answers[0]
        self.assertEqual((hello["ok"], hello["mitsuba"], hello["variant"]), (True, "3.9.1", "llvm_ad_rgb"))
        self.assertGreaterEqual(int(hello["llvm_version"].split(".")[0]), 16)
        kinds = [answer.get("kind") for answer in answers]
        internal = ["internal"]
        self.assertEqual(kinds, [None] + internal * 4 + [None, "scene", "scene", "unsupported"] + internal * 3 + [None])
        self.assertEqual(answers[5]["values"], [[[0.5, 0.5, 0.5]]])
        for word in ("radius", "colour", "unknown key"):
            self.assertIn(word, answers[7]["error"])
        self.assertIn("gyroid", answers[8]["error"])
        self.assertEqual((answers[12]["nodes"][0]["shape"], answers[12]["nodes"][0]["t"]), (-1, "inf"))

    @unittest.skipUnless(os.path.isdir("/proc"), "it reads /proc")
    def test_the_driver_ends_with_its_parent(self):
        """The parent is killed while the driver renders for many seconds."""
        text = film(1500, 1500) + DOWN + FLOOR + '[sampler]\ntype = "grid"\nsamples_per_axis = 16\n'
        parent = (
            "import subprocess, sys, time\n"
            "child = subprocess.Popen([sys.executable, '-m', 'whitstone_mitsuba', 'serve'], stdin=subprocess.PIPE, start_new_session=True)\n"
            "child.stdin.write(sys.argv[1].encode()); child.stdin.flush()\n"
            "print(child.pid, flush=True); time.sleep(600)"
        )
        with tempfile.TemporaryDirectory() as folder:
            request = json.dumps({"op": "render", "scene": text, "base": folder, "out": os.path.join(folder, "out.exr")})
            command = [sys.executable, "-c", parent, request + "\n"]
            environment = {**os.environ, "PYTHONPATH": ROOT}
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
                driver = int(process.stdout.readline())
                time.sleep(8)
                self.assertTrue(_runs(driver))
                process.kill()
            deadline = time.monotonic() + 5
            while _runs(driver) and time.monotonic() < deadline:
                time.sleep(0.05)
            self.assertFalse(_runs(driver))

    @unittest.skipUnless(sys.platform == "linux", "only Linux sends a signal when a pipe closes")
    def test_the_kernel_ends_the_driver(self):
        """The parent is killed while the driver loads a library that keeps the interpreter's lock,
        so that no thread of Python runs; and before the driver starts.
        """
        driver = (
            "import ctypes, os, subprocess, sys, time\n"
            "from whitstone_protocol import serve\n"
            "child = subprocess.Popen(['sleep', '60'])\n"
            "time.sleep(float(sys.argv[1]))\n"
            "print(os.getpid(), child.pid, flush=True)\n"
            "serve.run(lambda: ctypes.PyDLL(None).sleep(60))"
        )
        parent = (
            "import os, subprocess, sys, time\n"
            "read, write = os.pipe()\n"
            "subprocess.Popen([sys.executable, '-c', *sys.argv[1:]], pass_fds=[read], start_new_session=True,\n"
            "    stdin=subprocess.PIPE, env={**os.environ, 'WHITSTONE_PARENT': str(read)})\n"
            "time.sleep(600)"
        )
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([ROOT, os.path.dirname(os.path.dirname(serve.__file__))])}
        for wait in (0, 1):
            command = [sys.executable, "-c", parent, driver, str(wait)]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
                if wait == 0:
                    processes = [int(number) for number in process.stdout.readline().split()]
                    time.sleep(1)
                    self.assertTrue(all(map(_runs, processes)))
                    process.kill()
                else:
                    time.sleep(0.5)
                    process.kill()
                    processes = [int(number) for number in process.stdout.readline().split()]
            self.assertEqual(len(processes), 2)
            deadline = time.monotonic() + 1
            while any(map(_runs, processes)) and time.monotonic() < deadline:
                time.sleep(0.02)
            self.assertFalse(any(map(_runs, processes)), wait)

    def test_without_llvm(self):
        """A missing library gives an answer with instructions, not a crash."""
        with tempfile.TemporaryDirectory() as empty:
            code = (
                "import sys; from whitstone_mitsuba import llvm; llvm.candidates = lambda: iter([]);"
                "from whitstone_mitsuba.cli import main; sys.exit(main(['serve']))"
            )
            child = subprocess.run(
                [sys.executable, "-c", code],
                input='{"op": "hello"}\n',
                capture_output=True,
                text=True,
                env={**os.environ, "PYTHONPATH": ROOT},
                cwd=empty,
                timeout=300,
                check=False,
            )
        answer = json.loads(child.stdout)
        self.assertEqual((answer["ok"], answer["kind"]), (False, "internal"))
        self.assertIn("DRJIT_LIBLLVM_PATH", answer["error"])


class Commands(unittest.TestCase):
    def test_render_and_errors(self):
        with tempfile.TemporaryDirectory() as folder:
            scene, out = os.path.join(folder, "s.toml"), os.path.join(folder, "o.exr")
            with open(scene, "w", encoding="utf-8") as file:
                file.write(SCENE)
            child = run("render", scene, "-o", out)
            self.assertEqual(child.returncode, 0, child.stderr)
            self.assertEqual(json.loads(child.stdout)["width"], 4)
            self.assertTrue(os.path.exists(out))
            self.assertEqual(run("probe", scene, "9,9").returncode, 3)
            with open(scene, "a", encoding="utf-8") as file:
                file.write("[film2]\n")
            child = run("probe", scene, "0,0")
            self.assertEqual(child.returncode, 2)
            self.assertIn("film2", child.stderr)


if __name__ == "__main__":
    unittest.main()
