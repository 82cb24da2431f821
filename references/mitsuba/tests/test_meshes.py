"""OBJ and PLY files whose text is in another encoding than UTF-8 (model §9, *Mesh files*)."""

import os
import tempfile
import unittest

from support import Case
from whitstone_mitsuba import meshes


class Encodings(Case):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.base = folder.name

    def load(self, name, data, **wanted):
        path = os.path.join(self.base, name)
        with open(path, "wb") as file:
            file.write(data)
        return meshes.load(path, meshes.Wanted(**wanted))

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


if __name__ == "__main__":
    unittest.main()
