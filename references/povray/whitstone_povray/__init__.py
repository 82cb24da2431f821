"""POV-Ray 3.7 as a deterministic Whitted tracer, driven by the scene documents of Whitstone.

The contract is `docs/whitted-model.md`; how the harness talks to this package is
`references/mitsuba/PROTOCOL.md`, with the differences that `references/povray/README.md` names. The
standard library of Python 3.11 is all that it needs, and a `povray`.
"""

__version__ = "0.1.0"
