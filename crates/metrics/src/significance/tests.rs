use super::*;
use approx::assert_relative_eq;

const SIZE: usize = 48;

/// Means of `samples` samples of a distribution, with their sample variance. In a square, `bias` is
/// added to the mean.
fn noisy(seed: u64, samples: usize, bias: f32, squares: bool) -> Image {
    let mut state = seed;
    let mut random = move || {
        // SplitMix64.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut planes = vec![Vec::new(); 6];
    for index in 0..SIZE * SIZE {
        let inside = [index % SIZE, index / SIZE].iter().all(|at| (8..12).contains(at));
        for channel in 0..3 {
            let values: Vec<f64> = (0..samples).map(|_| 0.2 + random()).collect();
            let n = samples as f64;
            let mean = values.iter().sum::<f64>() / n;
            let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
            planes[channel].push(mean as f32 + if inside { bias } else { 0.0 });
            let square = values.iter().map(|v| v * v).sum::<f64>() / n;
            planes[3 + channel].push(if squares { square } else { variance } as f32);
        }
    }
    let mut image = Image::new(SIZE, SIZE).unwrap();
    let layer = if squares { "m2" } else { "variance" };
    for (i, plane) in planes.into_iter().enumerate() {
        let channel = RGB[i % 3];
        let name = if i < 3 {
            channel.to_owned()
        } else {
            format!("{layer}.{channel}")
        };
        image.add_channel(name, plane).unwrap();
    }
    image.set_attribute("samples", samples.to_string()).unwrap();
    image
}

fn exact() -> Image {
    Image::from_fn(SIZE, SIZE, |_, _| [0.7; 3]).unwrap()
}

fn found(ours: &Image, reference: &Image) -> Significance {
    significance(ours, reference, 0.01, Tolerance::default())
        .unwrap()
        .unwrap()
}

#[test]
fn tails_equal_those_of_scipy() {
    // 2 * scipy.stats.t.sf(t, degrees), version 1.17.
    for (t, degrees, expected) in [
        (0.5, 1.0, 0.7048327646991335),
        (2.0, 3.7, 0.12181720190523398),
        (6.0, 30.0, 1.3942768767204764e-06),
        (12.0, 9.5, 4.7125170143943235e-07),
        (40.0, 1000.0, 1.0478852155173272e-209),
    ] {
        assert_relative_eq!(student(t, degrees), expected, max_relative = 1e-9);
    }
    // scipy.special.erfc(z / sqrt(2)).
    for (z, expected) in [
        (0.1, 0.920344325445942),
        (1.96, 0.04999579029644087),
        (6.0, 1.9731752900754036e-09),
        (20.0, 5.5072482372126244e-89),
    ] {
        assert_relative_eq!(z_test(z * 0.5, 0.25), expected, max_relative = 1e-12);
    }
    // ttest_ind_from_stats(1.0, sqrt(0.04), 16, 1.2, sqrt(0.09), 25, equal_var=False).
    let part = |variance, samples| Part { variance, samples };
    assert_relative_eq!(
        welch(0.2, part(0.04, 16.0), part(0.09, 25.0)),
        0.014440789819268232,
        max_relative = 1e-9
    );
}

#[test]
fn noise_alone_is_not_significant_and_a_bias_is() {
    for squares in [false, true] {
        let reference = noisy(1, 24, 0.0, squares);
        let good = found(&noisy(2, 16, 0.0, squares), &reference);
        assert_eq!((good.test, good.pixels), (Test::Welch, 0), "{}", good.least_p);
        let bad = found(&noisy(2, 16, 1.2, squares), &reference);
        assert!((8..=16).contains(&bad.pixels), "{}", bad.pixels);
        assert!(
            bad.mask
                .pixels()
                .all(|(x, y)| (8..12).contains(&x) && (8..12).contains(&y))
        );
    }
    // Without the layers, the same difference would be over tolerance everywhere.
    let good = found(&exact(), &noisy(3, 400, 0.0, false));
    assert_eq!((good.test, good.pixels), (Test::Student, 0), "{}", good.least_p);
    assert!(good.least_at.is_some());
    let bad = found(&exact(), &noisy(3, 400, 0.2, false));
    assert_eq!(bad.pixels, 16);
    assert_eq!(
        significance(&exact(), &exact(), 0.01, Tolerance::default()),
        Ok(None)
    );
}

/// Means of 256 samples of 1 plus noise of a standard deviation, each with a bright event of a
/// probability that adds a hundredth to the expectation; `factor` multiplies all samples in a
/// square.
fn rare(seed: u64, deviation: f64, probability: f64, factor: f64) -> Image {
    let mut state = seed.wrapping_mul(0x2545_f491_4f6c_dd1d);
    let mut random = move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    let n = 256.0;
    let [mut means, mut variances] = [const { Vec::new() }; 2];
    for index in 0..SIZE * SIZE {
        let inside = [index % SIZE, index / SIZE].iter().all(|at| (8..12).contains(at));
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..256 {
            let noise = deviation * 12_f64.sqrt() * (random() - 0.5);
            let event = if random() < probability {
                0.01 / probability
            } else {
                0.0
            };
            let value = (1.0 + noise + event) * if inside { factor } else { 1.0 };
            sum += value;
            squares += value * value;
        }
        means.push((sum / n) as f32);
        variances.push(((squares - sum * sum / n) / (n - 1.0)).max(0.0) as f32);
    }
    let mut image = Image::new(SIZE, SIZE).unwrap();
    for channel in RGB {
        image.add_channel(channel, means.clone()).unwrap();
        image
            .add_channel(format!("variance.{channel}"), variances.clone())
            .unwrap();
    }
    image.set_attribute("samples", "256").unwrap();
    image
}

/// Unbiased images whose pixels miss a rare event are not significant: of 60 at a level of 1 %, at
/// most 3 (the probability of more is 0.3 %). By their own variances alone, all would be.
#[test]
fn rare_events_that_pixels_miss_are_not_significant() {
    let converged = Image::from_fn(SIZE, SIZE, |_, _| [1.01; 3]).unwrap();
    for (deviation, hits) in [(0.0, 0.1), (0.005, 0.1), (0.005, 0.3), (0.02, 1.0), (0.005, 4.0)] {
        let (mut alarms, mut alone) = (0, 0);
        for seed in 1..=60 {
            let noisy = rare(seed, deviation, hits / 256.0, 1.0);
            let found = found(&noisy, &converged);
            alarms += usize::from(found.pixels > 0);
            let values = noisy
                .channel("R")
                .unwrap()
                .iter()
                .zip(noisy.channel("variance.R").unwrap());
            let by_itself = |(mean, variance): (&f32, &f32)| {
                z_test(f64::from(mean - 1.01).abs(), f64::from(*variance) / 256.0) < found.threshold
            };
            alone += usize::from(values.clone().any(by_itself));
        }
        println!(
            "deviation {deviation}, {hits} events a pixel: {alarms} of 60, by each pixel's own variance {alone}"
        );
        assert!(alarms <= 3, "{deviation}, {hits}: {alarms}");
        if hits < 1.0 {
            assert!(alone >= 58, "the old rule must fail: {alone}");
        }
    }
}

/// A fault of 1 % is found if the noise permits it: a standard error of an eighth of that.
#[test]
fn a_fault_of_one_percent_is_found() {
    let converged = Image::from_fn(SIZE, SIZE, |_, _| [1.01; 3]).unwrap();
    for seed in 1..=20 {
        // Events in each sample are equivalent to none.
        let faulty = found(&rare(seed, 0.02, 1.0, 1.01), &converged);
        assert!(faulty.pixels >= 14, "seed {seed}: {} of 16", faulty.pixels);
        assert!(
            faulty
                .mask
                .pixels()
                .all(|(x, y)| (8..12).contains(&x) && (8..12).contains(&y))
        );
    }
}

#[test]
fn many_tests_have_a_small_threshold() {
    let one = found(&exact(), &noisy(3, 400, 0.0, false));
    assert_eq!(one.tests, 3 * SIZE * SIZE);
    assert_relative_eq!(
        1.0 - (1.0 - one.threshold).powi(one.tests as i32),
        0.01,
        max_relative = 1e-6
    );
    // Without it, one test in a hundred is significant by chance.
    let noisy = noisy(3, 400, 0.0, false);
    let values = noisy.rgb().unwrap().into_iter().flatten();
    let by_chance =
        values.filter(|&&value| z_test(f64::from((value - 0.7).abs()), 1.0 / 12.0 / 400.0) < 0.01);
    assert!((40..=100).contains(&by_chance.count()));
}

#[test]
fn without_variance_every_pixel_over_tolerance_is_significant() {
    let mut flat = exact();
    for channel in RGB {
        flat.add_channel(format!("variance.{channel}"), vec![0.0; SIZE * SIZE])
            .unwrap();
    }
    flat.add_channel("samples.N", vec![4.0; SIZE * SIZE]).unwrap();
    assert_eq!(found(&flat, &exact()).pixels, 0);
    let mut moved = exact();
    moved.channel_mut("G").unwrap()[5] = 0.7 * 1.0005;
    assert_eq!(found(&flat, &moved).pixels, 0, "within the tolerance");
    moved.channel_mut("G").unwrap()[5] = 0.702;
    assert_eq!(found(&flat, &moved).mask.pixels().collect::<Vec<_>>(), [(5, 0)]);
}

#[test]
fn unusable_layers_are_rejected() {
    let good = noisy(1, 4, 0.0, false);
    let fails = |change: &dyn Fn(&mut Image), text: &str| {
        let mut image = good.clone();
        change(&mut image);
        let error = significance(&image, &exact(), 0.01, Tolerance::default()).unwrap_err();
        assert!(error.to_string().contains(text), "{error}");
    };
    fails(
        &|image| drop(image.remove_channel("variance.G")),
        "no channel `variance.G`",
    );
    fails(
        &|image| image.set_attribute("samples", "many").unwrap(),
        "samples.N",
    );
    fails(
        &|image| image.set_attribute("samples", "1").unwrap(),
        "1 samples at column 0, row 0",
    );
    fails(
        &|image| image.channel_mut("variance.B").unwrap()[50] = f32::NAN,
        "NaN for B at column 2, row 1",
    );
    fails(
        &|image| image.channel_mut("variance.R").unwrap()[0] = -1.0,
        "-1 for R",
    );
    assert!(significance(&good, &exact(), 1.0, Tolerance::default()).is_err());
}

/// What noise explains is what the test of a pixel explains.
#[test]
fn the_limits_of_noise_are_those_of_the_test() {
    for (degrees, probability) in [(1.0, 1e-7), (3.0, 1e-3), (63.0, 2.7e-7)] {
        let t = critical_t(probability, degrees);
        let found = student(t, degrees);
        assert!((found / probability - 1.0).abs() < 1e-6, "{degrees}: {found}");
    }
    let mut image = Image::from_rgb(1, 1, &[[1.0; 3]]).unwrap();
    assert!(explained_by_noise(&image, 0.01).unwrap().is_none());
    for (name, value) in [
        ("variance.R", 0.5),
        ("variance.G", 0.5),
        ("variance.B", 0.5),
        ("samples.N", 8.0),
    ] {
        image.add_channel(name, vec![value]).unwrap();
    }
    let limit = explained_by_noise(&image, 0.01).unwrap().unwrap()[0][0];
    for (difference, expected) in [(0.99 * limit, 0), (1.01 * limit, 1)] {
        let other = Image::from_rgb(1, 1, &[[1.0 + difference as f32, 1.0, 1.0]]).unwrap();
        let found = significance(&image, &other, 0.01, Tolerance::default());
        assert_eq!(found.unwrap().unwrap().pixels, expected);
    }
}
