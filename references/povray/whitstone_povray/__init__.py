"""POV-Ray 3.7 as a deterministic Whitted tracer for Whitstone's scene documents.

The specification is `docs/whitted-model.md`. The protocol between the harness and this package is
`references/mitsuba/PROTOCOL.md`, with the differences that `references/povray/README.md` lists. It
needs only the standard library of Python 3.11 and the program `povray`.
"""

import os
import sys

# In a clone, where nothing is installed, the common package of the drivers is next to this one's
# folder. Where this driver is installed, it is installed too.
_PROTOCOL = os.path.join(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))), "protocol")
if os.path.isdir(os.path.join(_PROTOCOL, "whitstone_protocol")):
    sys.path.insert(0, _PROTOCOL)

__version__ = "0.1.0"
