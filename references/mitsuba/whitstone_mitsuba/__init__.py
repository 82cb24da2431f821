"""Mitsuba 3 as a deterministic, noise-free Whitted tracer, driven by the scene documents of
Whitstone.

The contract is `docs/whitted-model.md`; how the harness talks to this package is
`references/mitsuba/PROTOCOL.md`. Importing the package loads nothing heavy: Mitsuba and Dr.Jit are
imported by `runtime`, after a usable LLVM was found.
"""

__version__ = "0.1.0"
