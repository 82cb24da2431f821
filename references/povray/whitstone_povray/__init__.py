"""POV-Ray 3.7 as a deterministic Whitted tracer for Whitstone's scene documents.

The specification is `docs/whitted-model.md`. The protocol between the harness and this package is
`references/mitsuba/PROTOCOL.md`, with the differences that `references/povray/README.md` lists. It
needs only the standard library of Python 3.11 and the program `povray`.
"""

__version__ = "0.1.0"
