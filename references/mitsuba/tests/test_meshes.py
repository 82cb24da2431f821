"""Rules for OBJ and PLY files (model §9, *Mesh files*)."""

import os
import tempfile
import unittest

from support import Case
from whitstone_mitsuba import meshes
from whitstone_protocol.errors import SceneError


class Files(Case):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.base = folder.name

    def load(self, name, data, **wanted):
        path = os.path.join(self.base, name)
        with open(path, "wb") as file:
            file.write(data)
        return meshes.load(path, meshes.Wanted(**wanted))



class Encodings(Files):
    def test_names_of_parts(self):
        text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl gr\xfcn\nf 1 2 3\nusemtl gr\xe0\nf 2 3 1\nf 3 1 2\nusemtl \xc3\xa0\nf 1 2 3\n"
        for part, count in (("gr\u00fcn", 1), ("gr\u00e0", 2), ("\u00e0", 1)):
            self.assertEqual(len(self.load("parts.obj", text, part=part).faces), count, part)

    def test_comments(self):
        text = b"ply\nformat ascii 1.0\ncomment gr\xfcn\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        text += b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        self.assertEqual(self.load("comment.ply", text).faces.tolist(), [[0, 1, 2]])
        text = b"# gr\xfcn\nv 0 0 0 # gr\xfcn\nv 1 0 0\nv 0 1 0\nf 1 \\\r\n2 3\n"
        self.assertEqual(self.load("comment.obj", text).faces.tolist(), [[0, 1, 2]])


class Faces(Files):
    TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"

    def test_faces_without_a_normal_at_each_corner(self):
        text = self.TRIANGLE + b"v 0 0 1\nvn 1 1 1\nvt 0.5 0.5\nf 1/1/1 2/1/1 3/1/1 4/1\nf 1/1/1 2//1 3/1/1\n"
        found = self.load("partial.obj", text)
        normals = found.normals[found.faces]
        self.assertEqual(normals[0].tolist(), [[0, 0, 1]] * 3)
        self.assertEqual(normals[2].tolist(), [[1, 1, 1]] * 3)
        uvs = found.uvs[found.faces]
        self.assertEqual(uvs[0].tolist(), [[0.5, 0.5]] * 3)
        self.assertEqual(uvs[2].tolist(), [[0, 0]] * 3)

    def test_faces_before_their_vertices(self):
        found = self.load("before.obj", b"f 1 2 3\n" + self.TRIANGLE)
        self.assertEqual(found.positions[found.faces].tolist(), [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
        for wrong in (b"f 1 2 4\n", b"f 1 2 0\n", b"f 1 2 -1\n"):
            with self.assertRaisesRegex(SceneError, "out of range"):
                self.load("wrong.obj", wrong + self.TRIANGLE)

    def test_lists_of_vertices(self):
        text = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty list uchar int red\nproperty float y\nproperty float z\n"
        text += b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0\n1 2 7 8 0 0\n0 1 7 1 0\n3 0 1 2\n"
        found = self.load("lists.ply", text, colors=True)
        self.assertEqual(found.positions.tolist(), [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
        self.assertEqual(found.colors.tolist(), [[1, 1, 1, 1]] * 3)

    def test_lines_of_stl(self):
        text = b"solid a b\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n"
        text += b"   vertex 0 1 0\n  endloop\n endfacet\nendsolid a b\n"
        for end in (b"\n", b"\r\n", b"\r", b" ", b"\t"):
            found = self.load("lines.stl", text.replace(b"\n", end))
            self.assertEqual(found.positions.tolist(), [[0, 0, 0], [1, 0, 0], [0, 1, 0]], end)

    def test_a_byte_order_mark(self):
        found = self.load("mark.obj", b"\xef\xbb\xbf" + self.TRIANGLE + b"f 1 2 3\n")
        self.assertEqual(len(found.positions), 3)


if __name__ == "__main__":
    unittest.main()
