use approx::assert_relative_eq;
use proptest::prelude::*;

use super::*;

/// Smooth, positive, different in every channel and pixel.
fn picture(width: usize, height: usize) -> Image {
    Image::from_fn(width, height, |x, y| {
        let (x, y) = (x as f32, y as f32);
        [0.5 + 0.1 * (0.7 * x).sin(), 0.3 + 0.05 * y, 0.2 + 0.01 * x * y]
    })
    .unwrap()
}

fn map(image: &Image, change: impl Fn(usize, usize, [f32; 3]) -> [f32; 3]) -> Image {
    let planes = image.rgb().unwrap();
    Image::from_fn(image.width(), image.height(), |x, y| {
        change(x, y, planes.map(|plane| plane[y * image.width() + x]))
    })
    .unwrap()
}

fn default_compare(ours: &Image, reference: &Image) -> Metrics {
    compare(ours, reference, &CompareOptions::default()).unwrap()
}

#[test]
fn equal_images_have_zero_error() {
    let image = picture(33, 17);
    let metrics = default_compare(&image, &image);
    assert_eq!(
        (
            metrics.rmse,
            metrics.relmse,
            metrics.mae,
            metrics.max_abs,
            metrics.signed_mean
        ),
        (0.0, 0.0, 0.0, 0.0, 0.0)
    );
    assert_eq!(
        (
            metrics.rel_rmse_interior,
            metrics.psnr,
            metrics.pixels_over_tolerance
        ),
        (Some(0.0), None, 0)
    );
    assert_eq!(metrics.interior_pixels, 33 * 17);
}

/// A tenth of the picture is a lamp of radiance 1e7, and everything else is missing.
#[test]
fn a_bright_lamp_does_not_hide_errors() {
    let lit = |rest: f32| Image::from_fn(20, 10, |x, _| [if x < 2 { 1e7 } else { rest }; 3]).unwrap();
    let reference = lit(0.75);
    let metrics = compare(&lit(0.0), &reference, &CompareOptions::default()).unwrap();
    // The least power of two above the median is 1.
    assert_relative_eq!(
        metrics.mean_reference,
        0.1 * BRIGHT + 0.9 * 0.75,
        max_relative = 1e-15
    );
    assert_eq!(metrics.pixels_over_tolerance, 18 * 10);
    assert!(metrics.rel_rmse_interior.unwrap() > 0.05);
    // Neither black pixels nor their number change what counts as bright.
    let lamp = Image::from_fn(20, 10, |x, _| [if x == 0 { 100.0 } else { 0.0 }; 3]).unwrap();
    assert_relative_eq!(mean_reference(&lamp).unwrap(), 5.0, max_relative = 1e-15);
    let black = Image::from_fn(3, 2, |_, _| [0.0; 3]).unwrap();
    assert_eq!(mean_reference(&black).unwrap(), 0.0);
}

#[test]
fn closed_forms_for_constants() {
    // Values that f32 represents exactly.
    let reference = Image::from_fn(20, 10, |_, _| [0.5, 0.25, 1.0]).unwrap();
    let ours = Image::from_fn(20, 10, |_, _| [0.75, 0.25, 0.5]).unwrap();
    let metrics = compare(
        &ours,
        &reference,
        &CompareOptions {
            psnr_peak: Some(2.0),
            ..Default::default()
        },
    )
    .unwrap();
    assert_relative_eq!(metrics.rmse, (0.3125_f64 / 3.0).sqrt(), max_relative = 1e-15);
    assert_relative_eq!(metrics.mae, 0.25, max_relative = 1e-15);
    assert_eq!(metrics.max_abs, 0.5);
    assert_relative_eq!(metrics.signed_mean, -0.25 / 3.0, max_relative = 1e-15);
    assert_relative_eq!(metrics.mean_reference, 1.75 / 3.0, max_relative = 1e-15);
    assert_relative_eq!(
        metrics.relmse,
        (0.0625 / 0.26 + 0.25 / 1.01) / 3.0,
        max_relative = 1e-14
    );
    assert_relative_eq!(
        metrics.mape,
        (0.25 / 0.51 + 0.5 / 1.01) / 3.0,
        max_relative = 1e-14
    );
    assert_relative_eq!(
        metrics.smape,
        (0.5 / 1.26 + 1.0 / 1.51) / 3.0,
        max_relative = 1e-14
    );
    assert_relative_eq!(
        metrics.psnr.unwrap(),
        20.0 * (2.0 / metrics.rmse).log10(),
        max_relative = 1e-15
    );
    let mean = 1.75 / 3.0;
    let residuals = [0.25 / (0.5 + mean), 0.0, -0.5 / (1.0 + mean)];
    let expected = (residuals.iter().map(|r| r * r).sum::<f64>() / 3.0).sqrt();
    assert_relative_eq!(metrics.rel_rmse_interior.unwrap(), expected, max_relative = 1e-14);
    let bias = metrics.signed_block_bias.unwrap();
    assert_eq!((bias.channel, bias.x, bias.y, bias.pixels), ("B", 0, 0, 160));
    assert_relative_eq!(bias.bias, residuals[2], max_relative = 1e-14);
    assert_eq!(metrics.pixels_over_tolerance, 200);
    assert_eq!(default_compare(&ours, &reference).psnr_peak, 1.0);
}

#[test]
fn a_shift_of_one_pixel_shows() {
    let reference = picture(40, 30);
    let shifted = Image::from_fn(40, 30, |x, y| {
        let planes = reference.rgb().unwrap();
        planes.map(|plane| plane[y * 40 + (x + 1).min(39)])
    })
    .unwrap();
    let metrics = default_compare(&shifted, &reference);
    assert!(metrics.rmse > 0.05, "{metrics:?}");
    assert!(metrics.pixels_over_tolerance > 1000, "{metrics:?}");
}

#[test]
fn values_that_are_not_finite_fail_and_are_counted_on_each_side() {
    let good = picture(5, 4);
    let bad = map(&good, |x, y, [r, g, b]| match (x, y) {
        (3, 2) => [f32::NAN, g, f32::INFINITY],
        (4, 3) => [f32::NEG_INFINITY, g, b],
        _ => [r, g, b],
    });
    let Err(CompareError::NotFinite { count, first }) = compare(&bad, &good, &CompareOptions::default())
    else {
        panic!("no error");
    };
    assert_eq!(
        count,
        NotFinite {
            ours: 3,
            reference: 0
        }
    );
    assert_eq!((first.side, first.x, first.y), (Side::Ours, 3, 2));
    let Err(CompareError::NotFinite { count, first }) = compare(&good, &bad, &CompareOptions::default())
    else {
        panic!("no error");
    };
    assert_eq!(
        (count, first.side),
        (
            NotFinite {
                ours: 0,
                reference: 3
            },
            Side::Reference
        )
    );
    assert_eq!(
        count_not_finite(&bad, &bad).unwrap(),
        NotFinite {
            ours: 3,
            reference: 3
        }
    );

    // Over tolerance on either side, and even compared with itself.
    for (ours, reference) in [(&bad, &good), (&good, &bad), (&bad, &bad)] {
        let mask = over_tolerance(
            ours,
            reference,
            Tolerance {
                relative: 1e9,
                absolute: 1e9,
            },
        )
        .unwrap();
        assert_eq!(mask.pixels().collect::<Vec<_>>(), [(3, 2), (4, 3)]);
    }
    let first = worst(&good, &bad, 3, None).unwrap();
    assert_eq!((first[0].x, first[0].y, first[0].residual), (3, 2, f64::INFINITY));
    assert_eq!((first[1].x, first[1].y, first[1].residual), (4, 3, f64::INFINITY));
    assert_eq!(first[2].residual, 0.0);
}

#[test]
fn mismatched_images_and_options_are_errors() {
    let image = picture(6, 4);
    let error = compare(&image, &picture(4, 6), &CompareOptions::default()).unwrap_err();
    assert_eq!(
        error,
        CompareError::Size {
            ours: (6, 4),
            reference: (4, 6)
        }
    );

    let mut grey = Image::new(6, 4).unwrap();
    grey.add_channel("Y", vec![0.0; 24]).unwrap();
    let error = compare(&image, &grey, &CompareOptions::default()).unwrap_err();
    assert!(
        matches!(
            error,
            CompareError::Channel {
                side: Side::Reference,
                ..
            }
        ),
        "{error}"
    );
    assert_eq!(
        error.to_string(),
        "the reference: no channel `R`; available channels: Y"
    );

    let mut cropped = image.clone();
    cropped.set_placement(Placement {
        x: 1,
        ..image.placement()
    });
    assert!(matches!(
        compare(&image, &cropped, &CompareOptions::default()),
        Err(CompareError::Placement { .. })
    ));

    let mask = Mask::new(4, 6);
    let options = CompareOptions {
        exclude: Some(&mask),
        ..Default::default()
    };
    assert!(matches!(
        compare(&image, &image, &options),
        Err(CompareError::MaskSize { .. })
    ));
    assert!(matches!(
        worst(&image, &image, 1, Some(&mask)),
        Err(CompareError::MaskSize { .. })
    ));

    for value in [-1.0, f64::NAN, f64::INFINITY] {
        let tolerance = Tolerance {
            relative: value,
            ..Default::default()
        };
        assert!(matches!(
            over_tolerance(&image, &image, tolerance),
            Err(CompareError::Option { name: "relative", .. })
        ));
        let options = CompareOptions {
            psnr_peak: Some(value),
            ..Default::default()
        };
        assert!(matches!(
            compare(&image, &image, &options),
            Err(CompareError::Option {
                name: "psnr_peak",
                ..
            })
        ));
    }
}

#[test]
fn tolerance_is_sharp_on_both_sides() {
    let reference = Image::from_fn(8, 1, |_, _| [1.0, 1.0, 1.0]).unwrap();
    // Allowed: 1e-3 * 1 + 1e-4 * 1.
    let with = |offset: f32| {
        map(
            &reference,
            |x, _, [r, g, b]| if x == 5 { [r, g + offset, b] } else { [r, g, b] },
        )
    };
    let over = |image: &Image| {
        over_tolerance(image, &reference, Tolerance::default())
            .unwrap()
            .pixels()
            .collect::<Vec<_>>()
    };
    assert_eq!(over(&with(0.001_09)), []);
    assert_eq!(over(&with(-0.001_09)), []);
    assert_eq!(over(&with(0.001_11)), [(5, 0)]);
    assert_eq!(over(&with(-0.001_11)), [(5, 0)]);
}

#[test]
fn excluded_pixels_change_only_the_interior_metrics() {
    let reference = picture(40, 40);
    let ours = map(&reference, |x, y, [r, g, b]| {
        if x == 20 {
            [r + 1.0, g, b]
        } else {
            [r + 1e-5 * y as f32, g, b]
        }
    });
    let edge = Mask::from_fn(40, 40, |x, _| x == 20);
    let with = compare(
        &ours,
        &reference,
        &CompareOptions {
            exclude: Some(&edge),
            ..Default::default()
        },
    )
    .unwrap();
    let without = default_compare(&ours, &reference);
    assert_eq!(
        (with.interior_pixels, without.interior_pixels),
        (40 * 39, 40 * 40)
    );
    assert!(with.rel_rmse_interior.unwrap() < 1e-3 && without.rel_rmse_interior.unwrap() > 0.03);
    assert!(with.signed_block_bias.unwrap().bias < 1e-3 && without.signed_block_bias.unwrap().bias > 0.01);
    // The other numbers include all pixels in both cases.
    assert_eq!(
        (with.rmse, with.max_abs, with.relmse),
        (without.rmse, without.max_abs, without.relmse)
    );

    let all = Mask::from_fn(40, 40, |_, _| true);
    let none = compare(
        &ours,
        &reference,
        &CompareOptions {
            exclude: Some(&all),
            ..Default::default()
        },
    )
    .unwrap();
    assert_eq!(
        (
            none.rel_rmse_interior,
            none.signed_block_bias,
            none.interior_pixels
        ),
        (None, None, 0)
    );
}

#[test]
fn a_bias_below_tolerance_everywhere_is_detected() {
    // Blue, in the block at (32, 16), is too dark by 5e-4 of the value. Elsewhere the error is as
    // large, but with alternating signs.
    let reference = picture(64, 48);
    let ours = map(&reference, |x, y, [r, g, b]| {
        let biased = (32..48).contains(&x) && (16..32).contains(&y);
        let sign = if biased || (x + y) % 2 == 0 { -1.0 } else { 1.0 };
        [r, g, b * (1.0 + sign * 5e-4)]
    });
    let metrics = default_compare(&ours, &reference);
    assert_eq!(metrics.pixels_over_tolerance, 0);
    let bias = metrics.signed_block_bias.unwrap();
    assert_eq!((bias.channel, bias.x, bias.y, bias.pixels), ("B", 32, 16, 256));
    assert!(bias.bias < -3e-4 && bias.bias > -5e-4, "{bias:?}");

    let balanced = map(&reference, |x, y, [r, g, b]| {
        [r, g, b * (1.0 + if (x + y) % 2 == 0 { 5e-4 } else { -5e-4 })]
    });
    assert!(
        default_compare(&balanced, &reference)
            .signed_block_bias
            .unwrap()
            .bias
            .abs()
            < 1e-5
    );
}

#[test]
fn a_black_reference_stays_finite() {
    let black = Image::from_fn(4, 4, |_, _| [0.0; 3]).unwrap();
    let metrics = default_compare(&black, &black);
    assert_eq!(
        (
            metrics.rmse,
            metrics.rel_rmse_interior,
            metrics.pixels_over_tolerance
        ),
        (0.0, Some(0.0), 0)
    );
    let lit = map(&black, |x, _, _| [if x == 0 { f32::MAX } else { 0.0 }, 0.0, 0.0]);
    let metrics = default_compare(&lit, &black);
    assert_eq!(metrics.pixels_over_tolerance, 4);
    assert!(metrics.rel_rmse_interior.unwrap().is_finite() && metrics.rel_rmse_interior.unwrap() > 1e30);
    assert_eq!(metrics.psnr, None);
    let metrics = default_compare(&black, &lit);
    assert!(metrics.rmse.is_finite() && metrics.relmse.is_finite() && metrics.psnr.unwrap().is_finite());
}

#[test]
fn worst_pixels_are_sorted_and_ties_go_to_the_upper_left() {
    let reference = Image::from_fn(5, 5, |_, _| [1.0; 3]).unwrap();
    let ours = map(&reference, |x, y, _| match (x, y) {
        (4, 0) | (1, 3) => [1.0, 1.5, 1.0],
        (2, 2) => [1.0, 1.0, 0.0],
        _ => [1.0; 3],
    });
    let found = worst(&ours, &reference, 3, None).unwrap();
    assert_eq!(
        found.iter().map(|pixel| (pixel.x, pixel.y)).collect::<Vec<_>>(),
        [(2, 2), (4, 0), (1, 3)]
    );
    assert_eq!(found[0].ours, [1.0, 1.0, 0.0]);
    assert_eq!(found[0].residual, 0.5);
    assert_eq!(worst(&ours, &reference, 100, None).unwrap().len(), 25);
    assert_eq!(worst(&ours, &reference, 0, None).unwrap(), []);
    let corner = Mask::from_fn(5, 5, |x, y| x < 2 && y > 2);
    let inside = worst(&ours, &reference, 1, Some(&corner)).unwrap();
    assert_eq!((inside[0].x, inside[0].y), (1, 3));
}

proptest! {
    /// Rows are longer than what is kept of them, values repeat, and some are not finite.
    #[test]
    fn worst_pixels_are_the_first_of_all_sorted(
        values in prop::collection::vec(0..30u8, 3 * 400),
        count in 0..120usize,
    ) {
        let value = |k: usize| match values[k] {
            29 => f32::INFINITY,
            28 => f32::NAN,
            small => f32::from(small),
        };
        let reference = Image::from_fn(200, 2, |_, _| [1.0; 3]).unwrap();
        let ours = Image::from_fn(200, 2, |x, y| std::array::from_fn(|c| value(3 * (200 * y + x) + c))).unwrap();
        let residual = |k: usize| {
            let channels = (3 * k..3 * k + 3).map(value);
            let of = |v: f32| if v.is_finite() { (f64::from(v) - 1.0).abs() / 2.0 } else { f64::INFINITY };
            channels.map(of).fold(0.0, f64::max)
        };
        let mut all: Vec<(usize, f64)> = (0..400).map(|k| (k, residual(k))).collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        let found = worst(&ours, &reference, count, None).unwrap();
        let found: Vec<(usize, f64)> = found.iter().map(|p| (200 * p.y + p.x, p.residual)).collect();
        prop_assert_eq!(found, &all[..count]);
    }

    /// Scaling both images scales the absolute metrics and leaves the relative ones; powers of two
    /// are exact.
    #[test]
    fn scaling(seed in prop::collection::vec((0.0..4.0f32, 0.0..4.0f32), 12), exponent in -20..20i32) {
        let factor = 2.0_f32.powi(exponent);
        let image = |pick: fn(&(f32, f32)) -> f32, factor: f32| {
            Image::from_fn(2, 2, |x, y| std::array::from_fn(|c| pick(&seed[3 * (2 * y + x) + c]) * factor)).unwrap()
        };
        let plain = default_compare(&image(|s| s.0, 1.0), &image(|s| s.1, 1.0));
        let scaled = default_compare(&image(|s| s.0, factor), &image(|s| s.1, factor));
        let factor = f64::from(factor);
        prop_assert_eq!(scaled.max_abs, plain.max_abs * factor);
        approx::assert_relative_eq!(scaled.rmse, plain.rmse * factor, max_relative = 1e-14);
        approx::assert_relative_eq!(scaled.signed_mean, plain.signed_mean * factor, max_relative = 1e-12);
        prop_assert_eq!(scaled.rel_rmse_interior, plain.rel_rmse_interior);
        prop_assert_eq!(scaled.pixels_over_tolerance, plain.pixels_over_tolerance);
    }

    /// mae <= rmse <= max_abs, |signed_mean| <= mae, and exchanging the images changes only signs
    /// of the absolute ones.
    #[test]
    fn order_and_symmetry(seed in prop::collection::vec((-4.0..4.0f32, -4.0..4.0f32), 12)) {
        let image = |pick: fn(&(f32, f32)) -> f32| {
            Image::from_fn(4, 1, |x, _| std::array::from_fn(|c| pick(&seed[3 * x + c]))).unwrap()
        };
        let (a, b) = (image(|s| s.0), image(|s| s.1));
        let (there, back) = (default_compare(&a, &b), default_compare(&b, &a));
        let slack = 1.0 + 1e-14;
        prop_assert!(there.signed_mean.abs() <= there.mae * slack);
        prop_assert!(there.mae <= there.rmse * slack && there.rmse <= there.max_abs * slack);
        prop_assert_eq!(there.rmse, back.rmse);
        prop_assert_eq!(there.signed_mean, -back.signed_mean);
    }

    /// The number of pixels over tolerance falls as the tolerance grows.
    #[test]
    fn tolerance_is_monotonic(seed in prop::collection::vec((0.0..1.0f32, 0.0..1.0f32), 12), a in 0.0..1.0f64, b in 0.0..1.0f64) {
        let image = |pick: fn(&(f32, f32)) -> f32| {
            Image::from_fn(4, 1, |x, _| std::array::from_fn(|c| pick(&seed[3 * x + c]))).unwrap()
        };
        let count = |relative| {
            over_tolerance(&image(|s| s.0), &image(|s| s.1), Tolerance { relative, absolute: 0.0 }).unwrap().count()
        };
        prop_assert!(count(a.min(b)) >= count(a.max(b)));
    }
}
