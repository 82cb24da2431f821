//! Examples of every shape that the oracle supports, for tests and measurements.

use whitstone_core::DAffine3;

/// A shape as a scene file describes it, without its transform.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// The type of the shape.
    pub shape: &'static str,
    /// Its other keys. File paths are relative to the folder `scenes`.
    pub keys: &'static str,
    /// TOML tables of the groups that it instances.
    pub groups: &'static str,
}

const fn case(shape: &'static str, keys: &'static str) -> Case {
    Case {
        shape,
        keys,
        groups: "",
    }
}

/// At least one example for every type; the first one of a type is the basic one.
pub const CASES: [Case; 47] = [
    case("sphere", ""),
    case("sphere", "center = [1, -2, 3]\nradius = 0.01"),
    case("plane", ""),
    case("rectangle", ""),
    case("disk", ""),
    case("box", ""),
    case(
        "triangle",
        "vertices = [[-1.4, -1, 0], [1.4, -0.8, 0.3], [0.2, 1.2, -0.2]]",
    ),
    case("mesh", "file = \"assets/star.obj\""),
    case("mesh", "file = \"assets/torus.obj\""),
    case(
        "heightfield",
        "columns = 6\nrows = 5\namplitude = 0.6\nhills = 2\nseed = 5",
    ),
    case(
        "heightfield",
        "columns = 6\nrows = 5\nscale = -0.7\noffset = 0.4\n\
         height = { type = \"image\", file = \"assets/stones.png\", wrap = \"mirror\" }",
    ),
    case("ellipsoid", "radii = [1.4, 0.5, 0.9]"),
    case("ellipsoid", "radii = [1, 1e-3, 30]"),
    case("cylinder", "radius = 0.7"),
    case("cylinder", "radius = 0.6\nz = [-0.7, 0.5]\ncaps = false"),
    case("cone", "radii = [0.7, 0]\nz = [0, 1.7]"),
    case("cone", "radii = [0.6, 0.15]\nz = [-0.5, 0.5]\ncaps = false"),
    case("paraboloid", "radius = 0.8\nz = [0, 1.2]"),
    case("paraboloid", "radius = 0.6\nz = [0.2, 1.6]\ncaps = false"),
    case("hyperboloid", "radius = 0.4\nslope = 0.6\nz = [-1.2, 0.6]"),
    case("hyperboloid", "radius = 0.2\nz = [-0.7, 0.6]\ncaps = false"),
    case(
        "quadric",
        "coefficients = [1, 2, 1.5, 1, -0.5, 2.2, 0.1, 0, 0, -0.3]\nbox = [[-0.8, -0.7, -0.6], [0.7, 0.7, 0.8]]",
    ),
    case(
        "quadric",
        "matrix = [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, -1, 0], [0, 0, 0, 0.05]]\nbox = [[-0.7, -0.6, -1], [0.7, 0.6, 0.9]]",
    ),
    case(
        "quadric",
        "coefficients = [1, -1, 0, 0, 0, 0, 0, 0, -1.5, 0]\ncaps = false",
    ),
    case("torus", "minor_radius = 0.375"),
    case("torus", "major_radius = 2\nminor_radius = 1.9"),
    case("torus", "minor_radius = 0.02"),
    case(
        "polygon",
        "vertices = [[-1.25, -0.25, 0], [0.25, -0.25, 0], [0.25, -0.75, 0], [1.25, 0.125, 0], [0.25, 1, 0], [0.25, 0.5, 0], [-1.25, 0.5, 0], [-0.875, 0.125, 0]]",
    ),
    case(
        "polygon",
        "vertices = [[-0.5, -0.5, 0.75], [0.5, -0.5, -0.25], [0, 0, 0], [0.5, 0.5, -0.75], [-0.5, 0.5, 0.25]]",
    ),
    case(
        "prism",
        "outline = [[-0.9, -0.8], [0.8, -0.9], [1, 0.9], [0.3, 0.7], [0.1, -0.2], [-0.4, -0.3], [-0.5, 1], [-1, 0.8]]\ny = [-0.8, 0.7]",
    ),
    case(
        "prism",
        "outline = [[1, 0], [0, 1], [0.1, 0.1], [-1, 0], [0, -1]]\ny = [-0.01, 0.01]",
    ),
    case(
        "lathe",
        "outline = [[0, -0.9], [0.7, -0.9], [0.6, -0.7], [0.15, -0.6], [0.15, 0], [0.8, 0.2], [0.9, 0.9], [0.8, 0.9], [0.6, 0.3], [0, 0.1]]",
    ),
    case(
        "lathe",
        "outline = [[0.4, -0.9], [0.9, -0.3], [0.5, 0.4], [0.8, 0.8]]",
    ),
    case("lathe", "outline = [[0, 1], [1, 0.99], [1, -0.99], [0, -1]]"),
    case(
        "patch",
        "points = [[-1.6, 0, 1], [-1.1, 0.9, 1.2], [-0.4, -0.8, 1.1], [0.2, 0.3, 1], [-1.7, 0.6, 0.4], [-1, 0.4, 0.3], [-0.4, 0.2, 0.3], [0.1, 0.9, 0.4], [-1.5, -0.7, -0.4], [-1, 0.3, -0.3], [-0.3, 1.2, -0.3], [0.3, -0.2, -0.3], [-1.6, 0.2, -1], [-1.1, -0.6, -1.1], [-0.4, 0.8, -1.2], [0.2, 0.5, -1]]",
    ),
    case(
        "csg",
        "operation = \"union\"\noperands = [{ type = \"sphere\", radius = 0.6 }, { type = \"cylinder\", radius = 0.25, z = [-0.9, 0.9], transform = { rotate = { axis = [1, 0, 0], degrees = 60 } } }, { type = \"box\", transform = [{ scale = [0.9, 0.2, 0.2] }, { rotate = { axis = [0, 0, 1], degrees = 20 } }] }]",
    ),
    case(
        "csg",
        "operation = \"intersection\"\noperands = [{ type = \"box\", transform = { scale = 0.7 } }, { type = \"torus\", minor_radius = 0.4 }, { type = \"hyperboloid\", radius = 0.5, slope = 0.8, transform = { rotate = { axis = [1, 0, 0], degrees = 90 } } }]",
    ),
    case(
        "csg",
        "operation = \"difference\"\noperands = [{ type = \"csg\", operation = \"difference\", operands = [{ type = \"ellipsoid\", radii = [1, 0.8, 1] }, { type = \"ellipsoid\", radii = [0.9, 0.7, 0.9] }] }, { type = \"plane\", transform = [{ rotate = { axis = [1, 0, 0], degrees = 125 } }, { translate = [0, 0.3, 0] }] }, { type = \"cone\", radii = [0.1, 0.5], z = [-0.2, 1.2], transform = { rotate = { axis = [0, 1, 0], degrees = 75 } } }]",
    ),
    case(
        "csg",
        "operation = \"difference\"\noperands = [{ type = \"quadric\", coefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -1] }, { type = \"paraboloid\", radius = 0.8, z = [0, 2], transform = { translate = [0, 0, 0.1] } }]",
    ),
    case(
        "csg",
        "operation = \"difference\"\noperands = [{ type = \"implicit\", field = { smooth_union = { k = 0.3, of = [{ box = { half = [0.6, 0.3, 0.4] } }, { torus = { major = 0.6 } }] } } }, { type = \"isosurface\", size = [4, 5, 4], generator = \"metaballs\", seed = 4, balls = 10, iso_value = 0.7, transform = { translate = [0.3, 0.1, 0] } }]",
    ),
    case(
        "isosurface",
        "size = [14, 12, 16]\ngenerator = \"metaballs\"\nseed = 4\nballs = 10\niso_value = 0.3",
    ),
    case(
        "isosurface",
        "size = [3, 3, 3]\niso_value = 1\nvalues = [0, 1.25, 0, 1, 2, 1, 0, 1.5, 0, 1, 2, 1, 2, 0, 2, 1, 2, 1.125, 0, 1, 0, 1, 2, 1, 0, 1.25, 0]",
    ),
    case(
        "implicit",
        "field = { smooth_union = { k = 0.3, of = [{ sphere = { radius = 0.5 } }, { capsule = { a = [-0.5, 0.6, 0], b = [-0.3, -0.6, 0.4], radius = 0.15 } }, { rotate = { axis = [1, 0, 0], degrees = 75, of = { torus = { major = 0.7, minor = 0.12 } } } }] } }",
    ),
    case(
        "implicit",
        "field = { difference = [{ twist = { degrees_per_metre = 60, of = { box = { half = [0.5, 0.4, 0.95] } } } }, { translate = { by = [0, 0, 0.3], of = { sphere = { radius = 0.48 } } } }] }",
    ),
    case(
        "fractal",
        "kind = \"julia\"\nc = [-0.2, 0.6, 0.2, 0.2]\ndepth = 5",
    ),
    Case {
        shape: "instance",
        keys: "group = \"pair\"",
        groups: "[[group.pair.shape]]\ntype = \"sphere\"\nradius = 0.5\n[[group.pair.shape]]\ntype = \"box\"\ntransform = [{ scale = [0.2, 0.9, 0.2] }, { rotate = { axis = [1, 0, 1], degrees = 50 } }, { translate = [0.4, 0, 0.1] }]\n",
    },
    Case {
        shape: "instance",
        keys: "group = \"outer\"",
        groups: "[[group.inner.shape]]\ntype = \"torus\"\n[[group.outer.shape]]\ntype = \"instance\"\ngroup = \"inner\"\ntransform = [{ scale = [1, 0.5, 2] }, { rotate = { axis = [1, 2, 3], degrees = 70 } }]\n[[group.outer.shape]]\ntype = \"triangle\"\nvertices = [[-1, -1, 0.3], [1, -0.5, 0], [0.2, 1, -0.2]]\n",
    },
];

impl Case {
    /// A scene with only this shape, at the given transform.
    pub fn scene(&self, place: &DAffine3) -> String {
        let (m, t) = (place.matrix3, place.translation);
        let rows = [0, 1, 2].map(|i| {
            format!(
                "[{:?}, {:?}, {:?}, {:?}]",
                m.row(i).x,
                m.row(i).y,
                m.row(i).z,
                t[i]
            )
        });
        format!(
            "{}[[shape]]\ntype = \"{}\"\n{}\ntransform = {{ matrix = [{}] }}\n",
            self.groups,
            self.shape,
            self.keys,
            rows.join(", ")
        )
    }
}
