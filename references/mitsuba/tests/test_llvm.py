"""Which files are accepted as a usable libLLVM."""

import os
import tempfile
import unittest
from unittest import mock

import support  # noqa: F401  (puts the package on the path)

from whitstone_mitsuba import errors, llvm


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

    def test_none(self):
        with mock.patch.object(llvm, "candidates", lambda: iter(["/nowhere/libLLVM.so"])):
            with self.assertRaisesRegex(errors.EnvironmentFailure, "DRJIT_LIBLLVM_PATH(.|\n)*/nowhere/libLLVM.so"):
                llvm.find()


if __name__ == "__main__":
    unittest.main()
