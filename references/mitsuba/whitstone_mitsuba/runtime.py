"""The only module that imports Dr.Jit and Mitsuba, after it has found a usable LLVM."""

from __future__ import annotations

from . import llvm as _llvm

LLVM = _llvm.prepare()

import drjit as dr  # noqa: E402  (the library must be named first)
import mitsuba as mi  # noqa: E402

VARIANT = "llvm_ad_rgb"
mi.set_variant(VARIANT)
mi.set_log_level(mi.LogLevel.Error)

# The relative unit of the driver's offsets and perturbations: half the spacing of float32 numbers
# just above 1.
ULP = 2.0**-24


def set_threads(count: int) -> None:
    """Number of Dr.Jit's worker threads; 0 means one per processor."""
    import os

    dr.set_thread_count(count if count > 0 else (os.cpu_count() or 1))


__all__ = ["LLVM", "ULP", "VARIANT", "dr", "mi", "set_threads"]
