"""Checks that only POV-Ray itself can do: where the transparent shapes are.

POV-Ray keeps a list of the media that a ray is in; the model uses the indices of each surface as
given. The two agree unless transparent shapes overlap or touch, or the camera is inside one. A
program in POV-Ray's language checks this before the scene is rendered, and stops with an error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List

# Rays along each axis through the intersection of the bounding boxes of two bodies, in each
# direction.
RAYS = 24

# Prefix of the program's error messages; the number of the comment with the explanation follows.
MARK = "WHITSTONE-"

_MACROS = """
#macro Starts(P)
  #local I = 0;
  #while (I < dimension_size(T, 1))
    #if (inside(T[I], P)) #error concat("%(mark)s", str(I, 0, 0)) #end
    #local I = I + 1;
  #end
#end
#macro Window(P, A, B, W, H)
  #local Y = 0;
  #while (Y < H)
    #local X = 0;
    #while (X < W)
      Starts(P + (X + 0.5) / W * A + (Y + 0.5) / H * B)
      #local X = X + 1;
    #end
    #local Y = Y + 1;
  #end
#end
#macro Meet(A, B)
  #local L = <max(Low[A].x, Low[B].x), max(Low[A].y, Low[B].y), max(Low[A].z, Low[B].z)>;
  #local M = <min(High[A].x, High[B].x), min(High[A].y, High[B].y), min(High[A].z, High[B].z)>;
  #if (L.x <= M.x & L.y <= M.y & L.z <= M.z)
    #local Both = intersection { object { T[A] } object { T[B] } }
    #local N = <0, 0, 0>;
    #local X = 0;
    #while (X < %(rays)d)
      #local U = (X + 0.5) / %(rays)d;
      #local Y = 0;
      #while (Y < %(rays)d)
        #local V = (Y + 0.5) / %(rays)d;
        #local S = L + <0, U, V> * (M - L) - <1, 0, 0>;
        #local Q = trace(Both, S, x, N); #if (vlength(N) > 0) #error concat("%(mark)s", str(Count + A, 0, 0)) #end
        #local S = L + <U, 0, V> * (M - L) - <0, 1, 0>;
        #local Q = trace(Both, S, y, N); #if (vlength(N) > 0) #error concat("%(mark)s", str(Count + A, 0, 0)) #end
        #local S = L + <U, V, 0> * (M - L) - <0, 0, 1>;
        #local Q = trace(Both, S, z, N); #if (vlength(N) > 0) #error concat("%(mark)s", str(Count + A, 0, 0)) #end
        #local Y = Y + 1;
      #end
      #local X = X + 1;
    #end
  #end
#end
""" % {"mark": MARK, "rays": RAYS}

_PAIRS = """
#declare Low = array[Count];
#declare High = array[Count];
#declare A = 0;
#while (A < Count)
  #declare Low[A] = min_extent(T[A]);
  #declare High[A] = max_extent(T[A]);
  #declare B = 0;
  #while (B < A) Meet(A, B) #declare B = B + 1; #end
  #declare A = A + 1;
#end
"""


@dataclass(frozen=True)
class Body:
    """A placed object that light can enter: position of its table, its name, and its transform."""

    where: str
    name: str
    placing: str


def program(head: str, declarations: List[str], bodies: List[Body], origins: str) -> str:
    """The program; empty if there is nothing to check."""
    if not bodies:
        return ""
    inside = "POV-Ray does not refract if the camera is inside a transparent shape"
    meets = "POV-Ray has no twin of transparent shapes that overlap or touch: it keeps a list of media, the model uses the indices of each surface as given"
    reasons = [f"// {MARK}{number}: {body.where}: {inside}" for number, body in enumerate(bodies)]
    reasons += [f"// {MARK}{len(bodies) + number}: {body.where}: {meets}" for number, body in enumerate(bodies)]
    array = f"#declare Count = {len(bodies)};\n#declare T = array[Count];\n" + "\n".join(
        f"#declare T[{number}] = object {{ {body.name} {body.placing} }}" for number, body in enumerate(bodies)
    )
    camera = "camera { location <0,0,0> direction z }"
    return "\n".join([head, *reasons, *declarations, array, _MACROS, origins, _PAIRS, camera, ""])
