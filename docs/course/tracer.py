"""A small Whitted ray tracer: the solution of the programming exercises of the course.

    python3 tracer.py SCENE.toml IMAGE.pfm [--no-shadows] [--depth N]

It knows what the scenes of chapters 3, 4 and 6 use: spheres and a level plane; matte, Phong and
glass; point, ambient and background lights; a checkerboard. Scenes with other types end with exit
code 77, which `whitstone validate` reports as skipped. Keys that these three scenes do not use are
ignored. It needs Python 3.11, and nothing else.
"""

import struct
import sys
import tomllib
from math import exp, floor, inf, pi, sqrt, tan

# Smallest distance of a hit, in metres, so that a ray does not hit the surface on which it starts.
NEAREST = 1e-9


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def along(p, t, d):
    return (p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2])


def unit(a):
    length = sqrt(dot(a, a))
    return (a[0] / length, a[1] / length, a[2] / length)


def times(a, b):
    return tuple(x * y for x, y in zip(a, b))


def plus(a, b, factor=1.0):
    return tuple(x + factor * y for x, y in zip(a, b))


def color(value):
    return tuple(value) if isinstance(value, list) else (value,) * 3


def unsupported(what):
    print(f"this program does not know {what}")
    sys.exit(77)


class Sphere:
    def __init__(self, table):
        self.center = table.get("center", (0, 0, 0))
        self.radius = table.get("radius", 1)
        if "transform" in table:
            unsupported("transformed spheres")

    def hit(self, origin, direction):
        m = along(origin, -1, self.center)
        b = dot(m, direction)
        # The squared distance of the centre from the line, without a difference of large squares.
        across = along(m, -b, direction)
        d = self.radius**2 - dot(across, across)
        if d < 0:
            return inf
        first, second = -b - sqrt(d), -b + sqrt(d)
        return first if first > NEAREST else second if second > NEAREST else inf

    def normal(self, point):
        return unit(along(point, -1, self.center))


class Floor:
    def __init__(self, table):
        level = {"rotate": {"axis": [1, 0, 0], "degrees": -90}}
        if table.get("transform") not in (level, [level]):
            unsupported("planes other than y = 0")

    def hit(self, origin, direction):
        t = -origin[1] / direction[1] if direction[1] else inf
        return t if t > NEAREST else inf

    def normal(self, point):
        return (0, 1, 0)


SHAPES = {"sphere": Sphere, "plane": Floor}


class Scene:
    def __init__(self, document, shadows, depth):
        self.document = document
        integrator = document.get("integrator", {})
        recursive = integrator.get("type", "whitted") == "whitted"
        self.depth = min(depth, integrator.get("max_depth", 6)) if recursive else -1
        self.shadows = shadows and integrator.get("shadows", "opaque") != "none"
        self.shapes = []
        for table in document["shape"]:
            shape = SHAPES.get(table["type"]) or unsupported(f"shapes of type {table['type']}")
            material = table["material"]
            if isinstance(material, str):
                material = document["material"][material]
            if material["type"] not in ("matte", "phong", "dielectric"):
                unsupported(f"materials of type {material['type']}")
            self.shapes.append((shape(table), material))
        self.background = self.ambient = (0.0, 0.0, 0.0)
        self.lamps = []
        for light in document.get("light", []):
            match light["type"]:
                case "point":
                    self.lamps.append((light["position"], color(light["intensity"])))
                case "ambient":
                    self.ambient = plus(self.ambient, color(light["radiance"]))
                case "background":
                    self.background = plus(self.background, color(light["radiance"]))
                case other:
                    unsupported(f"lights of type {other}")

    def nearest(self, origin, direction):
        hits = ((shape.hit(origin, direction), i) for i, (shape, _) in enumerate(self.shapes))
        return min(hits)

    def radiance(self, origin, direction, depth, absorption):
        t, index = self.nearest(origin, direction)
        if t == inf:
            return self.far(absorption)
        shape, material = self.shapes[index]
        point, normal = along(origin, t, direction), shape.normal(along(origin, t, direction))
        outside = dot(normal, direction) < 0
        n = normal if outside else along((0, 0, 0), -1, normal)
        v = along((0, 0, 0), -1, direction)
        if material["type"] != "dielectric":
            found = self.local(point, n, v, material)
        else:
            found = (0.0, 0.0, 0.0)
            for d, weight, enters in branches(n, v, material, outside):
                medium = absorption
                if enters:
                    key = "absorption" if outside else "exterior_absorption"
                    medium = color(material.get(key, 0))
                if depth < self.depth:
                    light = self.radiance(point, d, depth + 1, medium)
                else:
                    light = self.far(medium) if self.depth >= 0 else (0, 0, 0)
                found = plus(found, light, weight)
        return times(found, tuple(exp(-a * t) for a in absorption))

    def far(self, absorption):
        return tuple(b if a == 0 else 0.0 for a, b in zip(absorption, self.background))

    def local(self, point, n, v, material):
        if material["type"] == "matte":
            reflectance = self.texture(material.get("reflectance", 0.5), point)
            found = times(reflectance, self.ambient)
        else:
            k_d, k_s = color(material.get("k_d", 0.5)), color(material.get("k_s", 0.5))
            found = times(color(material.get("k_a", material.get("k_d", 0.5))), self.ambient)
        for position, intensity in self.lamps:
            way = along(position, -1, point)
            distance = sqrt(dot(way, way))
            to_light = unit(way)
            cosine = dot(n, to_light)
            if cosine <= 0 or self.hidden(point, to_light, distance):
                continue
            if material["type"] == "matte":
                response = tuple(r / pi * cosine for r in reflectance)
            else:
                r = along(along((0, 0, 0), 2 * cosine, n), -1, to_light)
                highlight = max(0.0, dot(r, v)) ** material.get("exponent", 32)
                response = tuple(d * cosine + s * highlight for d, s in zip(k_d, k_s))
            found = plus(found, times(response, intensity), 1 / distance**2)
        return found

    def hidden(self, point, direction, distance):
        if not self.shadows:
            return False
        limit = distance * (1 - NEAREST)
        return any(shape.hit(point, direction) < limit for shape, _ in self.shapes)

    def texture(self, value, point):
        if not isinstance(value, dict):
            return color(value)
        if value["type"] != "checker":
            unsupported(f"textures of type {value['type']}")
        scale = value.get("scale", 1)
        scale = scale if isinstance(scale, list) else (scale, scale)
        # The plane is turned by -90 degrees about x: its own y is -z of the world.
        cell = floor(point[0] * scale[0]) + floor(-point[2] * scale[1])
        return color(value.get("a", 0.8) if cell % 2 == 0 else value.get("b", 0.2))

    def image(self):
        film, camera = self.document["film"], self.document["camera"]
        width, height = film["width"], film["height"]
        if camera["type"] != "perspective" or "window" in camera or "fov_axis" in camera:
            unsupported("this camera")
        look = camera["look_at"]
        e = tuple(look["origin"])
        w = unit(along(e, -1, look["target"]))
        u = unit(cross(look.get("up", (0, 1, 0)), w))
        v = cross(w, u)
        right = tan(camera.get("fov", 45) / 2 * pi / 180)
        rows = []
        for j in range(height):
            c = right * (height - 2 * (j + 0.5)) / width
            row = []
            for i in range(width):
                a = right * (2 * (i + 0.5) - width) / width
                d = unit(plus(plus(along((0, 0, 0), a, u), v, c), w, -1))
                row.append(self.radiance(e, d, 0, (0, 0, 0)))
            rows.append(row)
        return width, height, rows


def branches(n, v, material, outside):
    """The reflected and the transmitted direction, their weights, and whether they pass."""
    inner, outer = material.get("interior_ior", 1.5), material.get("exterior_ior", 1)
    eta = outer / inner if outside else inner / outer
    cos_i = dot(n, v)
    reflected = along(along((0, 0, 0), 2 * cos_i, n), -1, v)
    sin2 = eta**2 * (1 - cos_i**2)
    if sin2 >= 1:
        return [(reflected, 1.0, False)]
    cos_t = sqrt(1 - sin2)
    r_s = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    r_p = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    fresnel = (r_s**2 + r_p**2) / 2
    passed = along(along((0, 0, 0), eta * cos_i - cos_t, n), -eta, v)
    return [(reflected, fresnel, False), (passed, (1 - fresnel) * eta**2, True)]


def main():
    scene, image, *options = sys.argv[1:]
    depth = int(options[options.index("--depth") + 1]) if "--depth" in options else 1000
    with open(scene, "rb") as file:
        document = tomllib.load(file)
    width, height, rows = Scene(document, "--no-shadows" not in options, depth).image()
    with open(image, "wb") as file:
        # The rows of a portable float map go from the bottom up; -1 says little-endian.
        file.write(f"PF\n{width} {height}\n-1.0\n".encode())
        for row in reversed(rows):
            file.writelines(struct.pack("<3f", *pixel) for pixel in row)


main()
