"""The protocol of the reference drivers, which `references/mitsuba/PROTOCOL.md` specifies.

It contains what does not depend on the meaning of a scene: requests and answers, serve mode, the
command line, errors and image files. Every driver reads the scene with its own code, so that the
references stay independent. Needs only the standard library of Python 3.9.
"""

__version__ = "0.1.0"
