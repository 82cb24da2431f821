"""The command line."""

from __future__ import annotations

import sys

from . import _native


def main() -> int:
    """Runs the command of the process's arguments."""
    return _native.main(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
