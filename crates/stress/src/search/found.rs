//! Fixed cases: the worst that searches found, where the error was more than a twentieth of the
//! promised one.

/// A case that a search found, and that is asked again by every test run.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// The family.
    pub family: &'static str,
    /// The value of its parameter.
    pub parameter: f64,
    /// The ray: origin and direction; `None` for a whole step.
    pub ray: Option<[f64; 6]>,
}

/// The worst cases of earlier searches.
pub const FOUND: &[Found] = &[
    Found {
        family: "sphere_distance",
        parameter: 98.91639185203316,
        ray: Some([
            2.883479356765747,
            -70.08380126953125,
            -69.7452392578125,
            -0.028365321457386017,
            0.7120741009712219,
            0.7015311121940613,
        ]),
    },
    Found {
        family: "planet",
        parameter: 2.1908737737198902,
        ray: Some([
            0.0,
            2.0,
            0.0,
            0.4762468636035919,
            -0.876069962978363,
            0.07543431967496872,
        ]),
    },
    Found {
        family: "tangent",
        parameter: 0.07447929978935842,
        ray: Some([-3.999997615814209, -0.07800734788179398, 0.0, 1.0, 0.0, 0.0]),
    },
    Found {
        family: "world_offset",
        parameter: 1.5251346785839486,
        ray: Some([
            -12.41944408416748,
            3.841581106185913,
            6.485074996948242,
            0.8679531812667847,
            -0.3128100037574768,
            -0.385755330324173,
        ]),
    },
    Found {
        family: "sliver",
        parameter: 2.8879435982726887,
        ray: Some([
            2.057795763015747,
            2.061495542526245,
            -1.8053869009017944,
            -1.4125022888183594,
            -1.7347772121429443,
            1.9988460540771484,
        ]),
    },
    Found {
        family: "inside_ball",
        parameter: 1000.0,
        ray: None,
    },
    Found {
        family: "grazing_gallery",
        parameter: 0.07484002039770798,
        ray: None,
    },
    Found {
        family: "near_surface",
        parameter: 1.5614987820241287e-09,
        ray: Some([
            0.0,
            1.5614988191359203e-09,
            0.0,
            0.05425756052136421,
            -0.838365375995636,
            0.5424017310142517,
        ]),
    },
    Found {
        family: "wide_view",
        parameter: 21.971591494611438,
        ray: None,
    },
    Found {
        family: "telephoto",
        parameter: 0.009586730025876846,
        ray: None,
    },
    Found {
        family: "light_on_surface",
        parameter: 3.3237618266237126e-08,
        ray: None,
    },
    Found {
        family: "intensity_range",
        parameter: 7440.750479159159,
        ray: None,
    },
    Found {
        family: "horizon",
        parameter: 0.02987726913110339,
        ray: None,
    },
    Found {
        family: "filter_footprint",
        parameter: 248.54126544240935,
        ray: None,
    },
    Found {
        family: "ellipsoid_condition",
        parameter: 117.73427103888199,
        ray: Some([
            37.55038833618164,
            -6.339394569396973,
            118.66656494140625,
            -0.334746390581131,
            0.030440770089626312,
            -0.9418164491653442,
        ]),
    },
    Found {
        family: "instance_scale",
        parameter: 132.6325679458856,
        ray: Some([
            -32.337310791015625,
            0.006711345631629229,
            4.0,
            -0.2744731307029724,
            0.0,
            -1.0,
        ]),
    },
    Found {
        family: "direction_length",
        parameter: 1.183603750370151e20,
        ray: Some([
            -1.7078897953033447,
            3.6134355068206787,
            0.16185425221920013,
            6.7149827130326516e19,
            -9.74599014455066e19,
            1.2832512907715543e18,
        ]),
    },
    Found {
        family: "almost_zero",
        parameter: 9.999999999999996e-11,
        ray: Some([
            0.016255676746368408,
            -0.5928295850753784,
            3.0,
            1.8489485901068344e-10,
            -1.7161299266672545e-10,
            -1.0,
        ]),
    },
    Found {
        family: "almost_nothing",
        parameter: 1.4427651465238194e-67,
        ray: Some([
            3.292087109774182e-67,
            -4.47075077583721e-67,
            1.5747030606528977e-67,
            -0.5656937956809998,
            0.7665756344795227,
            -0.3038952946662903,
        ]),
    },
    Found {
        family: "absorption",
        parameter: 1.3514946518258313,
        ray: None,
    },
    Found {
        family: "twist",
        parameter: 197359.5611221362,
        ray: Some([
            1.2546276369417315,
            -1.2263085574833945,
            -0.9602483087540445,
            -0.6916719269660401,
            1.3165745527163142,
            0.0007725547950550027,
        ]),
    },
];
