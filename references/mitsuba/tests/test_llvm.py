"""Which files are accepted as a usable libLLVM."""

import os
import subprocess
import sys
import tempfile
import unittest
from unittest import mock

import support  # noqa: F401  (puts the package on the path)
from whitstone_mitsuba import llvm
from whitstone_protocol import errors


class Llvm(unittest.TestCase):
    def test_refused(self):
        with tempfile.TemporaryDirectory() as folder:
            script = os.path.join(folder, "libLLVM-99.so")
            with open(script, "w", encoding="ascii") as file:
                file.write("INPUT(libLLVM.so.99)\n")
            self.assertIsNone(llvm.version_of(script))
            self.assertIsNone(llvm.version_of(os.path.join(folder, "none.so")))
            with open(script, "wb") as file:
                file.write(b"\x7fELF but no more")
            self.assertIsNone(llvm.version_of(script))

    def test_old_ones_are_refused(self):
        for path in ("/usr/lib/x86_64-linux-gnu/libLLVM-14.so.1", "/usr/lib/x86_64-linux-gnu/libLLVM-15.so.1"):
            if os.path.exists(path):
                self.assertIsNone(llvm.version_of(path))

    def test_that_of_this_python_is_a_candidate(self):
        with tempfile.TemporaryDirectory() as folder:
            library = os.path.join(os.path.realpath(folder), "lib", "libLLVM.so.99.1")
            os.mkdir(os.path.dirname(library))
            with open(library, "wb"):
                pass
            self.assertNotIn(library, llvm.candidates())
            with mock.patch.object(llvm.sys, "prefix", folder):
                self.assertIn(library, llvm.candidates())

    def test_the_exit_code_says_whether_there_is_one(self):
        # A file that is no library comes first, and nothing else is looked at.
        nothing = "import runpy, glob, shutil; glob.glob = lambda *_: []; shutil.which = lambda _: '/nowhere'\n"
        code = nothing + "runpy.run_module('whitstone_mitsuba.llvm', run_name='__main__')"
        child = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, llvm.VARIABLE: __file__},
            cwd=os.path.dirname(os.path.dirname(os.path.abspath(__file__))),
            capture_output=True,
            text=True,
            check=False,
        )
        self.assertEqual(child.returncode, 1)
        self.assertIn(__file__, child.stderr)

    def test_none(self):
        with mock.patch.object(llvm, "candidates", lambda: iter(["/nowhere/libLLVM.so"])):
            with self.assertRaisesRegex(errors.EnvironmentFailure, "DRJIT_LIBLLVM_PATH(.|\n)*/nowhere/libLLVM.so"):
                llvm.find()


if __name__ == "__main__":
    unittest.main()
