//! The families whose laws can be checked in random configurations, and the scenes that demonstrate
//! failures.

use crate::accelerators::compare;
use crate::ball::Ball;
use crate::broken::Broken;
use crate::shapes::{first_broken, placements};
use crate::test_shapes::mesh_of;
use crate::{accelerator_laws, build, camera_laws, light_laws, material_laws, texture_laws};
use proptest::prelude::*;
use std::fmt::Debug;
use std::sync::Arc;
use toml::{Table, Value};
use whitstone_core::{
    Accelerators, Cameras, DAffine3, DVec3, Family, FilmSize, Geometry, Lights, LoweredShape, Materials,
    Plugin, Ray, SceneErrors, Shapes, Textures, Transform,
};

/// Number of rays per shape and per geometry of an accelerator.
const RAYS: u32 = 400;
/// Side of an image with a central pixel.
const SIDE: u32 = 65;

/// A family with laws. A check depends only on the table and the place.
pub trait Lawful: Family + Sized {
    /// The input of a plugin besides its table, which a scene specifies elsewhere.
    type Place: Clone + Debug + 'static;

    /// The places at which a table without ranges is always checked.
    fn fixed() -> Vec<Self::Place>;

    /// A strategy for random places.
    fn places() -> BoxedStrategy<Self::Place>;

    /// Builds the plugin of a table at a place.
    ///
    /// # Errors
    ///
    /// If it is rejected there.
    fn built<P: Plugin<Self>>(text: &str, place: &Self::Place) -> Result<Self::Product, SceneErrors>;

    /// Checks the laws of the family and additional `laws`; may also panic.
    ///
    /// # Errors
    ///
    /// The law that it breaks.
    fn check<P: Plugin<Self>>(
        text: &str,
        product: &Self::Product,
        place: &Self::Place,
        laws: &[fn(&Self::Product)],
    ) -> Result<(), Broken>;

    /// A scene that contains the table.
    fn scene(table: Table, place: &Self::Place, broken: &Broken) -> Table;

    /// The table of a plugin in such a scene, without its type, and the place.
    fn read(scene: &Table, kind: &str) -> Option<(Table, Self::Place)>;
}

/// Checks laws in addition to those of the family.
fn hold_all<T>(product: &T, laws: &[fn(&T)]) -> Result<(), Broken> {
    laws.iter().for_each(|law| law(product));
    Ok(())
}

fn vector(v: DVec3) -> Value {
    Value::from(v.to_array().to_vec())
}

fn read_vector(value: &Value) -> Option<DVec3> {
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_float).collect();
    let numbers: [f64; 3] = numbers?.try_into().ok()?;
    Some(DVec3::from_array(numbers))
}

/// The tables of every scene; light and ball may be replaced.
fn base() -> Table {
    toml::toml! {
        [camera]
        type = "perspective"
        fov = 30
        look_at = { origin = [0, 1, 5], target = [0, 0, 0] }

        [[light]]
        type = "point"
        position = [3, 5, 4]
        intensity = 300

        [[light]]
        type = "ambient"
        radiance = 0.2

        [[shape]]
        type = "sphere"
    }
}

fn film(size: FilmSize) -> Table {
    let mut film = Table::new();
    film.insert("width".to_owned(), i64::from(size.width).into());
    film.insert("height".to_owned(), i64::from(size.height).into());
    film
}

/// The base scene, with an image whose central pixel looks along the ray, if there is one.
fn seen_along(ray: Option<Ray>) -> Table {
    let mut scene = base();
    let size = FilmSize {
        width: SIDE,
        height: SIDE,
    };
    scene.insert("film".to_owned(), film(size).into());
    if let Some(ray) = ray {
        let mut look = Table::new();
        look.insert("origin".to_owned(), vector(ray.origin));
        look.insert("target".to_owned(), vector(ray.origin + ray.direction));
        look.insert(
            "up".to_owned(),
            vector(ray.direction.normalize().any_orthonormal_vector()),
        );
        if let Some(Value::Table(camera)) = scene.get_mut("camera") {
            camera.insert("look_at".to_owned(), look.into());
        }
    }
    scene
}

/// The table without its type, if the type is `kind`.
fn of_type(table: &Value, kind: &str) -> Option<Table> {
    let mut table = table.as_table()?.clone();
    (table.remove("type")?.as_str() == Some(kind)).then_some(table)
}

/// The base scene with another material on the ball.
fn on_the_ball(material: Table) -> Table {
    let mut scene = seen_along(None);
    if let Some(ball) = scene
        .get_mut("shape")
        .and_then(|list| list.get_mut(0)?.as_table_mut())
    {
        ball.insert("material".to_owned(), material.into());
    }
    scene
}

impl Lawful for Shapes {
    type Place = Transform;

    fn fixed() -> Vec<Transform> {
        placements().into_iter().map(|(_, place)| place).collect()
    }

    fn places() -> BoxedStrategy<Transform> {
        let places = Self::fixed();
        (0..places.len()).prop_map(move |number| places[number]).boxed()
    }

    fn built<P: Plugin<Self>>(text: &str, place: &Transform) -> Result<LoweredShape, SceneErrors> {
        build::<Self, P>(text, *place)
    }

    fn check<P: Plugin<Self>>(
        text: &str,
        product: &LoweredShape,
        place: &Transform,
        laws: &[fn(&LoweredShape)],
    ) -> Result<(), Broken> {
        hold_all(product, laws)?;
        // The laws take ownership of the product.
        let again = Self::built::<P>(text, place).map_err(|errors| errors.to_string())?;
        first_broken(again, RAYS)
    }

    fn scene(mut table: Table, place: &Transform, broken: &Broken) -> Table {
        let [x, y, z, w] = {
            let map = place.world_from_object();
            [
                map.matrix3.x_axis,
                map.matrix3.y_axis,
                map.matrix3.z_axis,
                map.translation,
            ]
        };
        let row = |i: usize| Value::from(vec![x[i], y[i], z[i], w[i]]);
        let mut transform = Table::new();
        transform.insert("matrix".to_owned(), vec![row(0), row(1), row(2)].into());
        table.insert("transform".to_owned(), transform.into());
        let mut scene = seen_along(broken.ray);
        scene.insert("shape".to_owned(), vec![Value::from(table)].into());
        scene
    }

    fn read(scene: &Table, kind: &str) -> Option<(Table, Transform)> {
        let mut table = of_type(scene.get("shape")?.get(0)?, kind)?;
        let matrix = table.remove("transform")?.get("matrix")?.clone();
        let row = |i: usize| -> Option<Vec<f64>> {
            matrix.get(i)?.as_array()?.iter().map(Value::as_float).collect()
        };
        let (x, y, z) = (row(0)?, row(1)?, row(2)?);
        let columns = (0..4).flat_map(|i| [&x, &y, &z].map(|row| row.get(i).copied()));
        let columns: Option<Vec<f64>> = columns.collect();
        let columns: [f64; 12] = columns?.try_into().ok()?;
        Some((table, Transform::new(DAffine3::from_cols_array(&columns))?))
    }
}

/// Triangles and balls.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Things {
    triangles: Vec<[DVec3; 3]>,
    balls: Vec<(DVec3, f64)>,
}

impl Things {
    fn geometry(&self) -> Geometry {
        let triangles = self.triangles.iter();
        let triangles = triangles.map(|corners| LoweredShape::Triangles(mesh_of(corners.to_vec())));
        let balls = self.balls.iter();
        let balls = balls.map(|&(center, radius)| LoweredShape::Custom(Box::new(Ball { center, radius })));
        Geometry::new(triangles.chain(balls).collect())
    }
}

/// Points in the cube [-1, 1]³, half of them on a grid, so that faces and corners coincide.
fn points() -> impl Strategy<Value = DVec3> {
    let number = prop_oneof![
        (-4..=4i32).prop_map(|number| 0.25 * f64::from(number)),
        (-1000..=1000i32).prop_map(|number| 1e-3 * f64::from(number)),
    ];
    [number.clone(), number.clone(), number].prop_map(DVec3::from_array)
}

impl Lawful for Accelerators {
    type Place = Things;

    fn fixed() -> Vec<Things> {
        vec![Things::default()]
    }

    fn places() -> BoxedStrategy<Things> {
        let triangles = proptest::collection::vec([points(), points(), points()], 0..60);
        let balls = proptest::collection::vec((points(), 0.01..0.5), 0..20);
        (triangles, balls)
            .prop_map(|(triangles, balls)| Things { triangles, balls })
            .boxed()
    }

    fn built<P: Plugin<Self>>(text: &str, place: &Things) -> Result<Self::Product, SceneErrors> {
        build::<Self, P>(text, Arc::new(place.geometry()))
    }

    fn check<P: Plugin<Self>>(
        text: &str,
        product: &Self::Product,
        place: &Things,
        laws: &[fn(&Self::Product)],
    ) -> Result<(), Broken> {
        hold_all(product, laws)?;
        compare(&place.geometry(), &**product, RAYS)?;
        // The empty place selects all prepared geometries, once per table.
        if *place == Things::default() {
            accelerator_laws::<P>(text);
        }
        Ok(())
    }

    fn scene(table: Table, place: &Things, broken: &Broken) -> Table {
        let mut scene = seen_along(broken.ray);
        let shape = |kind: &str, rest: &[(&str, Value)]| {
            let mut shape = Table::new();
            shape.insert("type".to_owned(), kind.into());
            shape.extend(rest.iter().map(|(key, value)| ((*key).to_owned(), value.clone())));
            Value::from(shape)
        };
        let triangles = place.triangles.iter();
        let triangles =
            triangles.map(|corners| shape("triangle", &[("vertices", corners.map(vector).to_vec().into())]));
        let balls = place.balls.iter();
        let balls = balls.map(|&(center, radius)| {
            shape("sphere", &[("center", vector(center)), ("radius", radius.into())])
        });
        scene.insert("shape".to_owned(), Value::Array(triangles.chain(balls).collect()));
        scene.insert("accelerator".to_owned(), table.into());
        scene
    }

    fn read(scene: &Table, kind: &str) -> Option<(Table, Things)> {
        let mut things = Things::default();
        for shape in scene.get("shape")?.as_array()? {
            if let Some(table) = of_type(shape, "triangle") {
                let corners: Option<Vec<DVec3>> = table
                    .get("vertices")?
                    .as_array()?
                    .iter()
                    .map(read_vector)
                    .collect();
                things.triangles.push(corners?.try_into().ok()?);
            } else if let Some(table) = of_type(shape, "sphere") {
                let radius = table.get("radius")?.as_float()?;
                things.balls.push((read_vector(table.get("center")?)?, radius));
            }
        }
        Some((of_type(scene.get("accelerator")?, kind)?, things))
    }
}

/// Families whose plugins are built from little more than their table: how to check them, and where
/// scenes contain them.
macro_rules! lawful {
    ($family:ty, $place:ty: $places:expr, $fixed:expr, |$input:ident| $given:expr;
     check |$product:ident, $at:ident, $laws:ident| $check:expr;
     scene |$table:ident, $where:ident| $scene:expr; read |$document:ident, $kind:ident| $read:expr) => {
        impl Lawful for $family {
            type Place = $place;

            fn fixed() -> Vec<$place> {
                $fixed
            }

            fn places() -> BoxedStrategy<$place> {
                $places.boxed()
            }

            fn built<P: Plugin<Self>>(text: &str, $input: &$place) -> Result<Self::Product, SceneErrors> {
                build::<Self, P>(text, $given)
            }

            fn check<P: Plugin<Self>>(
                _: &str,
                $product: &Self::Product,
                $at: &$place,
                $laws: &[fn(&Self::Product)],
            ) -> Result<(), Broken> {
                let _ = $at;
                $check;
                hold_all($product, $laws)
            }

            fn scene($table: Table, $where: &$place, _: &Broken) -> Table {
                let _ = $where;
                $scene
            }

            fn read($document: &Table, $kind: &str) -> Option<(Table, $place)> {
                $read
            }
        }
    };
}

lawful! {
    Materials, (): Just(()), vec![()], |none| *none;
    check |material, _at, laws| if laws.is_empty() { material_laws(&**material) };
    scene |table, _at| on_the_ball(table);
    read |scene, kind| Some((of_type(scene.get("shape")?.get(0)?.get("material")?, kind)?, ()))
}

lawful! {
    Textures, (): Just(()), vec![()], |none| *none;
    check |texture, _at, _laws| texture_laws(&**texture);
    scene |table, _at| {
        let mut matte = Table::new();
        matte.insert("type".to_owned(), "matte".into());
        matte.insert("reflectance".to_owned(), table.into());
        on_the_ball(matte)
    };
    read |scene, kind| {
        let material = scene.get("shape")?.get(0)?.get("material")?;
        Some((of_type(material.get("reflectance")?, kind)?, ()))
    }
}

lawful! {
    Lights, (): Just(()), vec![()], |none| *none;
    check |light, _at, _laws| light_laws(&**light);
    scene |table, _at| {
        let mut scene = seen_along(None);
        scene.insert("light".to_owned(), vec![Value::from(table)].into());
        scene
    };
    read |scene, kind| Some((of_type(scene.get("light")?.get(0)?, kind)?, ()))
}

const FILMS: [FilmSize; 4] = [
    FilmSize {
        width: 64,
        height: 48,
    },
    FilmSize { width: 1, height: 1 },
    FilmSize {
        width: 7,
        height: 300,
    },
    FilmSize {
        width: 1001,
        height: 3,
    },
];

lawful! {
    Cameras, FilmSize: (0..FILMS.len()).prop_map(|number| FILMS[number]), FILMS.to_vec(), |film| *film;
    check |camera, film, _laws| camera_laws(&**camera, *film);
    scene |table, size| {
        let mut scene = base();
        scene.insert("film".to_owned(), film(*size).into());
        scene.insert("camera".to_owned(), table.into());
        scene
    };
    read |scene, kind| {
        let side = |name: &str| u32::try_from(scene.get("film")?.get(name)?.as_integer()?).ok();
        let (width, height) = (side("width")?, side("height")?);
        Some((of_type(scene.get("camera")?, kind)?, FilmSize { width, height }))
    }
}
