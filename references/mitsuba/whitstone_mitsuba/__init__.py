"""Mitsuba 3 as a deterministic, noise-free Whitted tracer for Whitstone's scene documents.

The specification is `docs/whitted-model.md`. The protocol between the harness and this package is
`references/mitsuba/PROTOCOL.md`. Importing the package loads nothing heavy: `runtime` imports
Mitsuba and Dr.Jit, after it has found a usable LLVM.
"""

__version__ = "0.1.0"
