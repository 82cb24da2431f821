//! Wireframe pictures of the bounds of an accelerator, and of rays, drawn over the dimmed picture
//! of the scene.

use crate::terminal::Failure;
use whitstone_core::{DMat4, DVec2, DVec3, DVec4, DebugBounds};
use whitstone_image::{Raster, ToneMap};
use whitstone_render::{Pipeline, RenderOptions};

/// Colours by level, from the root down, repeated. They differ in hue and in brightness (Okabe and
/// Ito's palette, which people with any colour vision can tell apart).
const COLORS: [[u8; 3]; 7] = [
    [255, 255, 255],
    [230, 159, 0],
    [86, 180, 233],
    [240, 228, 66],
    [0, 158, 115],
    [213, 94, 0],
    [204, 121, 167],
];

/// Factor by which the picture below is dimmed.
const DIM: f64 = 0.4;

/// The picture of a scene with the bounds of its accelerator down to a level.
///
/// # Errors
/// If the accelerator has no bounds, or the camera cannot project points into its image.
pub fn picture(pipeline: &Pipeline, deepest: usize) -> Result<Raster, Failure> {
    let kind = &pipeline.accelerator.0;
    let outlines = pipeline.scene.accelerator.debug_bounds(deepest).ok_or_else(|| {
        Failure::usage(format!(
            "the accelerator \"{kind}\" has no boxes to draw; choose another one, for example with `--set accelerator.type=bvh2`"
        ))
    })?;
    lines(pipeline, &outlines)
}

/// The picture of a scene with lines, coloured by their level. Nothing hides them.
///
/// # Errors
/// If the camera cannot project points into its image.
pub fn lines(pipeline: &Pipeline, outlines: &[DebugBounds]) -> Result<Raster, Failure> {
    let projection = pipeline.camera.projection().ok_or_else(|| {
        Failure::usage("this camera has no projection matrix, so lines cannot be drawn; use another camera")
    })?;
    let film = pipeline.render(RenderOptions::default());
    let image = film.to_image(&pipeline.scene_hash).map_err(Failure::usage)?;
    let picture = Raster::preview(&image, ToneMap::default()).map_err(Failure::usage)?;
    Ok(draw(&picture, &projection, outlines))
}

/// The colour of a level.
fn color(depth: usize) -> [u8; 3] {
    COLORS[depth % COLORS.len()]
}

/// Draws lines over the dimmed picture. Deeper levels are drawn first, so that they do not hide the
/// larger volumes around them.
fn draw(picture: &Raster, projection: &DMat4, outlines: &[DebugBounds]) -> Raster {
    let mut drawn = Raster::from_fn(picture.width(), picture.height(), |x, y| {
        let pixel = picture.pixel(x, y).unwrap_or_default();
        pixel.map(|value| (f64::from(value) * DIM) as u8)
    });
    let size = DVec2::new(picture.width() as f64, picture.height() as f64);
    let mut order: Vec<&DebugBounds> = outlines.iter().collect();
    order.sort_by_key(|outline| std::cmp::Reverse(outline.depth));
    for outline in order {
        for &segment in &outline.segments {
            if let Some(ends) = project(segment, projection, size) {
                line(&mut drawn, ends, color(outline.depth));
            }
        }
    }
    drawn
}

/// The end points in the image of the part of a segment that lies in front of the camera and in the
/// picture. Clips before the division (Blinn and Newell, *Clipping using homogeneous coordinates*,
/// 1978), so that lines that pass the camera keep their direction.
fn project(segment: [DVec3; 2], projection: &DMat4, size: DVec2) -> Option<[DVec2; 2]> {
    let [a, b] = segment.map(|end| *projection * end.extend(1.0));
    let (low, high) = window(size);
    let inside = |p: DVec4| {
        [
            p.z,
            p.x - low.x * p.w,
            high.x * p.w - p.x,
            p.y - low.y * p.w,
            high.y * p.w - p.y,
        ]
    };
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for (start, end) in inside(a).into_iter().zip(inside(b)) {
        let crossing = start / (start - end);
        match (start >= 0.0, end >= 0.0) {
            (true, true) => {}
            (true, false) => to = to.min(crossing),
            (false, true) => from = from.max(crossing),
            (false, false) => return None,
        }
    }
    let ends = [from, to]
        .map(|t| a.lerp(b, t))
        .map(|end| end.truncate().truncate() / end.w);
    (from <= to && ends.iter().all(|end| end.is_finite())).then_some(ends)
}

/// The rectangle of the picture, extended by one pixel.
fn window(size: DVec2) -> (DVec2, DVec2) {
    (DVec2::NEG_ONE, size + DVec2::ONE)
}

/// Draws an anti-aliased line one pixel wide. Each pixel across its steeper direction is weighted
/// by the part of its height that the line covers (Gupta and Sproull 1981, with a box filter).
fn line(picture: &mut Raster, ends: [DVec2; 2], color: [u8; 3]) {
    let size = DVec2::new(picture.width() as f64, picture.height() as f64);
    let Some([a, b]) = clip(ends, size) else {
        return;
    };
    let along = b - a;
    let steep = along.y.abs() > along.x.abs();
    let turned = |p: DVec2| if steep { DVec2::new(p.y, p.x) } else { p };
    let (mut a, mut b) = (turned(a), turned(b));
    if a.x > b.x {
        (a, b) = (b, a);
    }
    let slope = if b.x > a.x { (b.y - a.y) / (b.x - a.x) } else { 0.0 };
    for column in a.x.floor() as i64..=b.x.floor() as i64 {
        // The part of this column that the line crosses.
        let length = (b.x.min(column as f64 + 1.0) - a.x.max(column as f64)).max(0.0);
        // The position of the line at the middle of the column, measured from the middles of the
        // rows.
        let y = a.y + slope * (column as f64 + 0.5 - a.x) - 0.5;
        for row in [y.floor(), y.floor() + 1.0] {
            let cover = length * (1.0 - (row - y).abs());
            let [x, y] = if steep {
                [row as i64, column]
            } else {
                [column, row as i64]
            };
            blend(picture, x, y, color, cover);
        }
    }
}

fn blend(picture: &mut Raster, x: i64, y: i64, color: [u8; 3], cover: f64) {
    let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else {
        return;
    };
    if let Some(below) = picture.pixel(x, y) {
        let mix = |i: usize| f64::from(below[i]) * (1.0 - cover) + f64::from(color[i]) * cover;
        picture.set(x, y, [0, 1, 2].map(|i| (mix(i) + 0.5) as u8));
    }
}

/// The part of a line inside the picture extended by one pixel (Liang and Barsky 1984).
fn clip([a, b]: [DVec2; 2], size: DVec2) -> Option<[DVec2; 2]> {
    let (low, high) = window(size);
    let along = b - a;
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        let (start, step) = (a[axis], along[axis]);
        if step == 0.0 && !(low[axis] <= start && start <= high[axis]) {
            return None;
        }
        if step != 0.0 {
            let (p, q) = ((low[axis] - start) / step, (high[axis] - start) / step);
            from = from.max(p.min(q));
            to = to.min(p.max(q));
        }
    }
    (from <= to).then(|| [a + from * along, a + to * along])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lit(picture: &Raster) -> Vec<(usize, usize)> {
        let all = (0..picture.height()).flat_map(|y| (0..picture.width()).map(move |x| (x, y)));
        all.filter(|&(x, y)| picture.pixel(x, y) != Some([0; 3]))
            .collect()
    }

    /// A camera at the origin that looks along z, with ten pixels per unit of slope and the middle
    /// of the image at (8, 6).
    fn projection() -> DMat4 {
        let rows = [
            DVec4::new(10.0, 0.0, 8.0, 0.0),
            DVec4::new(0.0, 10.0, 6.0, 0.0),
            DVec4::Z,
            DVec4::Z,
        ];
        DMat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose()
    }

    fn drawn(segments: &[[DVec3; 2]]) -> Raster {
        let outline = DebugBounds {
            depth: 0,
            segments: segments.to_vec(),
        };
        draw(&Raster::filled(16, 12, [0; 3]), &projection(), &[outline])
    }

    #[test]
    fn a_line_is_where_its_ends_project_to() {
        // From (3, 4.5) to (13, 4.5), two units away: the row of pixels whose middles it crosses.
        let ends = [DVec3::new(-1.0, -0.3, 2.0), DVec3::new(1.0, -0.3, 2.0)];
        let picture = drawn(&[ends]);
        assert_eq!(lit(&picture), (3..13).map(|x| (x, 4)).collect::<Vec<_>>());
        assert_eq!(picture.pixel(3, 4), Some([255; 3]));
        // Between two rows it covers half of each, and nothing else.
        let picture = drawn(&[ends.map(|end| end - 0.1 * DVec3::Y)]);
        assert_eq!(lit(&picture).len(), 20);
        assert_eq!(
            (picture.pixel(5, 3), picture.pixel(5, 4)),
            (Some([128; 3]), Some([128; 3]))
        );
        // Rotated by a quarter turn.
        let turned = ends.map(|end| DVec3::new(end.y, end.x, end.z));
        assert!(lit(&drawn(&[turned])).iter().all(|&(x, _)| x == 6));
    }

    #[test]
    fn lines_behind_the_camera_are_not_drawn() {
        let behind = [DVec3::new(-1.0, 0.1, -2.0), DVec3::new(1.0, 0.1, -2.0)];
        assert_eq!(lit(&drawn(&[behind])), []);
        // A line that passes the camera: from the middle it runs to the right and out of the
        // picture.
        let past = [DVec3::new(0.5, 0.05, 1e9), DVec3::new(0.5, 0.05, -1e9)];
        let found = lit(&drawn(&[past]));
        assert!(
            found.iter().all(|&(x, y)| x >= 7 && (5..8).contains(&y)),
            "{found:?}"
        );
        assert!(
            (8..16).all(|column| found.iter().any(|&(x, _)| x == column)),
            "{found:?}"
        );
    }

    #[test]
    fn lines_far_outside_are_cut_off_and_cost_nothing() {
        let far = [DVec3::new(-1e12, -1e11, 1.0), DVec3::new(1e12, 1e11, 1.0)];
        assert!(!lit(&drawn(&[far])).is_empty());
        let outside = [DVec3::new(-1e30, 5.0, 1.0), DVec3::new(1e30, 5.0, 1.0)];
        assert_eq!(lit(&drawn(&[outside])), []);
        // Too far away for any number to locate it: whatever is drawn, drawing terminates.
        drawn(&[far.map(|end| 1e288 * end)]);
    }

    #[test]
    fn levels_have_their_colours_and_the_whole_is_on_top() {
        let segments = vec![[DVec3::new(-1.0, -0.3, 2.0), DVec3::new(1.0, -0.3, 2.0)]];
        let outlines = [0, 1, 2].map(|depth| DebugBounds {
            depth,
            segments: segments.clone(),
        });
        let below = Raster::filled(16, 12, [200, 100, 0]);
        let picture = draw(&below, &projection(), &outlines);
        assert_eq!(picture.pixel(5, 4), Some([255; 3]));
        assert_eq!(picture.pixel(0, 0), Some([80, 40, 0]));
        let picture = draw(&below, &projection(), &outlines[1..]);
        assert_eq!(picture.pixel(5, 4), Some(color(1)));
    }
}
