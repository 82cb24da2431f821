"""Finds a libLLVM that Dr.Jit can use, before Dr.Jit is imported.

Dr.Jit loads the library named by `DRJIT_LIBLLVM_PATH`. Versions below 16 crash it (Debian's default
is 14). Some files called `libLLVM*.so` are linker scripts of a few bytes, not libraries (the Rust
toolchain has one). So each candidate is loaded in a child process, which queries its version. A
library that crashes then takes down only the child.
"""

from __future__ import annotations

import glob
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from typing import Iterator, Optional

from whitstone_protocol.errors import EnvironmentFailure

MINIMUM_MAJOR = 16
VARIABLE = "DRJIT_LIBLLVM_PATH"

# Runs in a child process: prints "22.1.0", or nothing if the library is too old to have the
# function (added in LLVM 16).
_ASK_VERSION = """
import ctypes, sys
library = ctypes.CDLL(sys.argv[1])
numbers = [ctypes.c_uint() for _ in range(3)]
library.LLVMGetVersion(*[ctypes.byref(number) for number in numbers])
print(".".join(str(number.value) for number in numbers))
"""


@dataclass(frozen=True)
class Llvm:
    """A libLLVM that was loaded successfully, with its version."""

    path: str
    version: str


def version_of(path: str) -> Optional[str]:
    """The version of the LLVM library at `path`, or None if it cannot be loaded or is too old."""
    try:
        with open(path, "rb") as file:
            if file.read(4) not in (b"\x7fELF", b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe"):
                return None
    except OSError:
        return None
    try:
        child = subprocess.run(
            [sys.executable, "-S", "-c", _ASK_VERSION, path], capture_output=True, text=True, timeout=60, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    version = child.stdout.strip()
    if child.returncode != 0 or not re.fullmatch(r"\d+(\.\d+)*", version):
        return None
    return version if int(version.split(".")[0]) >= MINIMUM_MAJOR else None


def _rust_libraries() -> Iterator[str]:
    """The Rust toolchain's own LLVM: every machine that can build Whitstone has it."""
    rustc = shutil.which("rustc") or os.path.expanduser("~/.cargo/bin/rustc")
    try:
        child = subprocess.run([rustc, "--print", "sysroot"], capture_output=True, text=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return
    sysroot = child.stdout.strip()
    if child.returncode == 0 and sysroot:
        for pattern in ("libLLVM*.so*", "libLLVM*.dylib"):
            # Largest first: a linker script of the same name lies next to the library.
            yield from sorted(glob.glob(os.path.join(sysroot, "lib", pattern)), key=os.path.getsize, reverse=True)


def _system_libraries() -> Iterator[str]:
    """libLLVM from the system's packages or those of this Python, highest version in the name first."""
    patterns = (
        "/usr/lib/llvm-*/lib/libLLVM*.so*",
        "/usr/lib/*-linux-gnu/libLLVM*.so*",
        "/usr/lib64/libLLVM*.so*",
        "/usr/lib/libLLVM*.so*",
        "/usr/local/lib/libLLVM*.so*",
        "/opt/homebrew/opt/llvm/lib/libLLVM*.dylib",
        os.path.join(glob.escape(sys.prefix), "lib", "libLLVM*.so*"),
    )
    found = {os.path.realpath(path) for pattern in patterns for path in glob.glob(pattern)}

    def major(path: str) -> int:
        numbers = re.findall(r"\d+", os.path.basename(path)) or re.findall(r"llvm-(\d+)", path)
        return int(numbers[0]) if numbers else 0

    for path in sorted(found, key=lambda path: (-major(path), path)):
        if major(path) == 0 or major(path) >= MINIMUM_MAJOR:
            yield path


def candidates() -> Iterator[str]:
    """All candidate paths in order of preference."""
    named = os.environ.get(VARIABLE)
    if named:
        yield named
    yield from _rust_libraries()
    yield from _system_libraries()


def find() -> Llvm:
    """The first usable libLLVM. Raises `EnvironmentFailure` with instructions if there is none."""
    tried = []
    for path in candidates():
        version = version_of(path)
        if version is not None:
            return Llvm(path, version)
        tried.append(path)
    listing = "".join(f"\n  {path}" for path in tried) or "\n  (no candidates were found)"
    raise EnvironmentFailure(
        f"no usable libLLVM (version {MINIMUM_MAJOR} or later) was found. Install a system package such as libllvm19, a Rust toolchain (it "
        f"contains a suitable libLLVM) or, on Linux x86-64, the Python package karellen-llvm-core; or set {VARIABLE} to the library file. "
        f"Tried:{listing}"
    )


def prepare() -> Llvm:
    """Finds the library and passes its path to Dr.Jit; must run before `import drjit`."""
    llvm = find()
    os.environ[VARIABLE] = llvm.path
    return llvm


if __name__ == "__main__":
    # Asked by the harness when it makes the environment: without a library it installs one.
    try:
        print(find().path)
    except EnvironmentFailure as failure:
        sys.exit(str(failure))
