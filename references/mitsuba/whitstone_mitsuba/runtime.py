"""The one place that imports Dr.Jit and Mitsuba, once a usable LLVM is named to them."""

from __future__ import annotations

from . import llvm as _llvm

LLVM = _llvm.prepare()

import drjit as dr  # noqa: E402  (the library must be named first)
import mitsuba as mi  # noqa: E402

VARIANT = "llvm_ad_rgb"
mi.set_variant(VARIANT)
mi.set_log_level(mi.LogLevel.Error)

# One relative unit of the driver's offsets and perturbations: half the spacing of float32 numbers
# just above 1.
ULP = 2.0**-24


def set_threads(count: int) -> None:
    """Worker threads of Dr.Jit; 0 means one for each processor."""
    import os

    dr.set_thread_count(count if count > 0 else (os.cpu_count() or 1))


__all__ = ["LLVM", "ULP", "VARIANT", "dr", "mi", "set_threads"]
