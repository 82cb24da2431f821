"""Twin of the shape `mesh`: POV-Ray's `mesh2`, whose numbers are single precision."""

from __future__ import annotations

from typing import List

from whitstone_protocol.errors import SceneError, Unsupported

from .. import meshes, transforms
from . import Fields, Place, Solid, Surface, baked, coincident, sdl


def _list(name: str, entries: List[str]) -> str:
    return f"{name} {{ {len(entries)}, {','.join(entries)} }}"


def twin(fields: Fields, place: Place) -> Solid:
    """`file`, `shading`, `uv_sets`; neither subdivided nor displaced. Nothing that reads vertex
    colours or tangents has a twin, so these keys have no effect.
    """
    path = fields.path("file")
    smooth = fields.choice("shading", "smooth", ("smooth", "flat")) == "smooth"
    surface = Surface("x", "y", mapped=True)
    if fields.take("subdivision") is not None:
        fields.unsupported("POV-Ray does not subdivide: the twin would be the same mesh as Mitsuba's", "subdivision")
    if fields.take("displacement") is not None:
        fields.unsupported("POV-Ray does not displace: the twin would be the same mesh as Mitsuba's", "displacement")
    sets = fields.take("uv_sets", [0])
    if sets not in ([], [0]):
        fields.unsupported("POV-Ray has one set of texture coordinates, and this driver reads the first one only", "uv_sets")
    fields.flag("vertex_colors", False)
    fields.flag("tangents", False)
    for key in ("mesh", "primitive", "skin", "weights"):
        if fields.take(key) is not None and not path.lower().endswith((".gltf", ".glb")):
            fields.error(key, "requires a file ending in .gltf or .glb")
    try:
        mesh = meshes.load(path)
    except SceneError as error:
        fields.error("file", str(error))
        return Solid("union {", surface, True)
    except Unsupported as error:
        fields.unsupported(str(error), "file")
        return Solid("union {", surface, True)
    # The model normalises normals at the vertices, after the shape's own transform.
    rounded = meshes.rounding(place.setting)
    scale = place.setting.scale
    moved = [transforms.point(place.own, vertex) for vertex in mesh.positions]
    parts = [_list("vertex_vectors", [sdl.vector(rounded(scale * c) for c in vertex) for vertex in moved])]
    faces = mesh.faces
    indices = [sdl.vector_of_integers(face) for face in faces]
    if smooth and mesh.normals:
        turned = [transforms.normal(place.own, normal) for normal in mesh.normals]
        corners = []
        for face, own in zip(faces, mesh.normal_faces):
            if own is None:
                # Faces without normals of their own have the geometric one.
                a, b, c = (moved[corner] for corner in face)
                turned.append(transforms.unit(transforms.cross(transforms.sub(b, a), transforms.sub(c, a))))
                own = (len(turned) - 1,) * 3
            corners.append(own)
        parts.append(_list("normal_vectors", [sdl.vector(rounded(c) for c in normal) for normal in turned]))
        normal_indices = [sdl.vector_of_integers(face) for face in corners]
    else:
        normal_indices = []
    uvs = list(mesh.uvs) + [(0.0, 0.0)]
    parts.append(_list("uv_vectors", [sdl.vector(uv) for uv in uvs]))
    none = (len(uvs) - 1,) * 3
    uv_indices = [sdl.vector_of_integers((face or none) if sets else none) for face in mesh.uv_faces]
    parts.append(_list("face_indices", indices))
    if normal_indices:
        parts.append(_list("normal_indices", normal_indices))
    parts.append(_list("uv_indices", uv_indices))
    outline = coincident.mesh(mesh.positions, faces)
    return Solid("mesh2 { " + "\n".join(parts), surface, meshes.closed(mesh), baked(), smooth=bool(normal_indices), outline=outline)
