//! Pictures of AOV layers for people.

use whitstone_image::png::{NOT_FINITE, Raster};
use whitstone_image::{Image, ToneMap};

/// Colour of a miss: no id, an infinite depth.
const NOTHING: [u8; 3] = [0; 3];
/// The darkest grey of a finite depth; misses are [`NOTHING`].
const DARKEST: f64 = 40.0;

/// Names of the layers of an image, without duplicates: the part of a channel's name before the
/// last point. Colour channels are skipped.
#[must_use]
pub fn layers(image: &Image) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in image.channels() {
        if let Some((layer, _)) = name.rsplit_once('.')
            && !names.contains(&layer)
        {
            names.push(layer);
        }
    }
    names
}

/// A layer of two images in the same colours. `None` if either lacks it or its kind is unknown.
///
/// Channel `I` is an id. Each id has its own colour; negative ones are black. A single channel `Z`
/// is a distance in grey on a logarithmic scale over the range of the second image; near ones are
/// bright, infinite ones black. `X`, `Y`, `Z` are a direction, drawn as `0.5 + 0.5 v`. `U`, `V` are
/// texture coordinates, drawn by their fractional part. `R`, `G`, `B` are a part of the radiance,
/// drawn like a picture. NaN is [`NOT_FINITE`].
#[must_use]
pub fn layer_views(ours: &Image, reference: &Image, layer: &str) -> Option<[Raster; 2]> {
    let planes = |image: &'_ Image, channels: &[&str]| -> Option<Vec<Vec<f32>>> {
        let plane = |channel: &&str| image.channel(&format!("{layer}.{channel}")).map(<[f32]>::to_vec);
        channels.iter().map(plane).collect()
    };
    let both = |channels: &[&str]| Some([planes(ours, channels)?, planes(reference, channels)?]);
    let draw = |image: &Image, planes: &[Vec<f32>], color: &dyn Fn(&[f64]) -> [u8; 3]| {
        Raster::from_fn(image.width(), image.height(), |x, y| {
            let place = y * image.width() + x;
            let values: Vec<f64> = planes.iter().map(|plane| f64::from(plane[place])).collect();
            if values.iter().any(|value| value.is_nan()) {
                NOT_FINITE
            } else {
                color(&values)
            }
        })
    };
    let views = |[mine, theirs]: [Vec<Vec<f32>>; 2], color: &dyn Fn(&[f64]) -> [u8; 3]| {
        [draw(ours, &mine, color), draw(reference, &theirs, color)]
    };
    if let Some(ids) = both(&["I"]) {
        return Some(views(ids, &|values| id_color(values[0])));
    }
    if let Some(directions) = both(&["X", "Y", "Z"]) {
        return Some(views(directions, &|v| {
            [v[0], v[1], v[2]].map(|v| byte(0.5 + 0.5 * v))
        }));
    }
    if let Some(coordinates) = both(&["U", "V"]) {
        return Some(views(coordinates, &|v| {
            [byte(v[0] - v[0].floor()), byte(v[1] - v[1].floor()), 0]
        }));
    }
    if let Some(colors) = both(&["R", "G", "B"]) {
        let tone = ToneMap::default();
        return Some(views(colors, &|v| [v[0], v[1], v[2]].map(|v| tone.encode(v))));
    }
    let depths = both(&["Z"])?;
    let seen = depths[1][0].iter().map(|&depth| f64::from(depth));
    let (near, far) = seen
        .filter(|depth| depth.is_finite() && *depth > 0.0)
        .fold((f64::INFINITY, 0.0), |(near, far), depth| {
            (depth.min(near), depth.max(far))
        });
    let decades = libm::log(far / near).max(f64::MIN_POSITIVE);
    Some(views(depths, &|depth| {
        if !depth[0].is_finite() || depth[0] <= 0.0 {
            return NOTHING;
        }
        let part = (libm::log(depth[0] / near) / decades).clamp(0.0, 1.0);
        [(255.0 - part * (255.0 - DARKEST)).round() as u8; 3]
    }))
}

fn byte(value: f64) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Neighbouring ids get very different colours: hues by the golden ratio.
fn id_color(id: f64) -> [u8; 3] {
    if id < 0.0 || !id.is_finite() {
        return NOTHING;
    }
    let golden = (5.0_f64.sqrt() - 1.0) / 2.0;
    let hue = (id * golden + 0.11).fract();
    let bright = [1.0, 0.8, 0.6][(id % 3.0) as usize];
    // Of hue, saturation 0.6 and brightness:
    // https://en.wikipedia.org/wiki/HSL_and_HSV#HSV_to_RGB_alternative
    [5.0, 3.0, 1.0].map(|n: f64| {
        let k = (n + hue * 6.0) % 6.0;
        byte(bright * (1.0 - 0.6 * k.min(4.0 - k).clamp(0.0, 1.0)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(channels: &[(&str, [f32; 4])]) -> Image {
        let mut image = Image::from_fn(2, 2, |_, _| [0.0; 3]).unwrap();
        for (name, values) in channels {
            image.add_channel(*name, values.to_vec()).unwrap();
        }
        image
    }

    #[test]
    fn every_layer_has_its_picture_and_both_sides_share_colours() {
        let of = |depth: f32| {
            image(&[
                ("shape_id.I", [-1.0, 0.0, 1.0, 0.0]),
                ("depth.Z", [f32::INFINITY, 1.0, depth, f32::NAN]),
                ("normal.X", [0.0, 1.0, -1.0, 0.0]),
                ("normal.Y", [0.0; 4]),
                ("normal.Z", [0.0; 4]),
                ("uv.U", [0.0, 0.25, 1.25, -0.75]),
                ("uv.V", [0.0; 4]),
                ("path.direct.R", [0.0, 1.0, 4.0, f32::NAN]),
                ("path.direct.G", [0.0; 4]),
                ("path.direct.B", [0.0; 4]),
            ])
        };
        let (ours, reference) = (of(4.0), of(16.0));
        assert_eq!(
            layers(&ours),
            ["depth", "normal", "path.direct", "shape_id", "uv"]
        );
        let of_layer = |name| layer_views(&ours, &reference, name).unwrap();
        let [ids, same] = of_layer("shape_id");
        assert_eq!(ids, same);
        assert_eq!(ids.pixels()[0], NOTHING);
        assert_eq!(ids.pixels()[1], ids.pixels()[3]);
        assert_ne!(ids.pixels()[1], ids.pixels()[2]);
        let [mine, theirs] = of_layer("depth").map(|raster| raster.pixels().to_vec());
        assert_eq!([mine[0], mine[1], mine[3]], [NOTHING, [255; 3], NOT_FINITE]);
        // The middle of the reference's two decades; both images use its scale.
        assert_eq!(theirs[2], [40; 3]);
        assert_eq!(mine[2], [148; 3]);
        assert_eq!(of_layer("normal")[0].pixels()[1], [255, 128, 128]);
        let [uv, _] = of_layer("uv");
        assert!(uv.pixels()[1..].iter().all(|color| *color == [64, 0, 0]));
        let [direct, _] = of_layer("path.direct");
        assert_eq!(direct.pixels(), [[0; 3], [255, 0, 0], [255, 0, 0], NOT_FINITE]);
        assert!(layer_views(&ours, &reference, "color").is_none());
        assert!(layer_views(&ours, &image(&[]), "uv").is_none());
    }

    #[test]
    fn neighbouring_ids_have_distinct_colours() {
        let colors: Vec<[u8; 3]> = (0..64).map(|id| id_color(f64::from(id))).collect();
        for pair in colors.windows(2) {
            let far = (0..3).map(|c| pair[0][c].abs_diff(pair[1][c])).max();
            assert!(far > Some(40), "{pair:?}");
        }
    }
}
