use super::*;
use whitstone_core::GlossyLobe;

struct Made {
    lobes: BsdfFlags,
    needs: SurfaceAttributes,
    local: fn(&SurfaceInteraction, DVec3, &LightSamples<'_>) -> f64,
    branches: fn(&SurfaceInteraction, DVec3) -> Vec<SpecularRay>,
    lobe: &'static [DVec3],
    reflections: u32,
    transmissions: u32,
    /// The sign of the lobe's normal.
    side: fn(SpecularRayKind) -> f64,
}

impl Material for Made {
    fn flags(&self) -> BsdfFlags {
        self.lobes
    }
    fn needs(&self) -> SurfaceAttributes {
        self.needs
    }
    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        Rgb::splat((self.local)(point, view, light))
    }
    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        for branch in (self.branches)(point, view) {
            out.push(branch);
        }
    }
    fn reflections(&self) -> u32 {
        self.reflections
    }
    fn transmissions(&self) -> u32 {
        self.transmissions
    }
    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        let n = (self.side)(kind) * point.n_towards(view);
        let spread = kind == SpecularRayKind::Reflection || self.transmissions > 1;
        (!self.lobe.is_empty() && spread).then_some(GlossyLobe { n, lobe: self.lobe })
    }
}

fn lambert(point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> f64 {
    let n = point.n_towards(view);
    let term = |light: &IncidentLight| light.irradiance.g * n.dot(light.direction).max(0.0);
    light.ambient.g + light.lights.iter().map(term).sum::<f64>()
}

fn mirrored(point: &SurfaceInteraction, view: DVec3) -> SpecularRay {
    let n = point.n_towards(view);
    SpecularRay {
        direction: (2.0 * n.dot(view) * n - view).normalize(),
        weight: Rgb::splat(0.5),
        kind: SpecularRayKind::Reflection,
    }
}

fn straight(view: DVec3) -> SpecularRay {
    SpecularRay {
        direction: -view,
        weight: Rgb::splat(0.5),
        kind: SpecularRayKind::Transmission {
            absorption: Rgb::BLACK,
        },
    }
}

const RIGHT: Made = Made {
    lobes: BsdfFlags::LOCAL,
    needs: SurfaceAttributes::SHADING_NORMAL,
    local: lambert,
    branches: |_, _| Vec::new(),
    lobe: &[],
    reflections: 1,
    transmissions: 1,
    side: |kind| {
        if kind == SpecularRayKind::Reflection {
            1.0
        } else {
            -1.0
        }
    },
};

/// A glossy lobe of two directions, at a cosine of 0.8 to the mirror direction.
const SPREAD: Made = Made {
    branches: |point, view| vec![mirrored(point, view)],
    lobe: &[DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.6, 0.0, 0.8)],
    reflections: 2,
    ..RIGHT
};

fn all() -> BsdfFlags {
    BsdfFlags::LOCAL | BsdfFlags::REFLECTION | BsdfFlags::TRANSMISSION
}

#[test]
fn a_correct_material_passes() {
    material_laws(&Made {
        lobes: all(),
        branches: |point, view| vec![mirrored(point, view), straight(view)],
        ..RIGHT
    });
}

#[test]
fn a_glossy_material_passes() {
    material_laws(&Made {
        lobes: all(),
        ..SPREAD
    });
}

#[test]
fn a_material_that_spreads_both_rays_passes() {
    material_laws(&Made {
        lobes: all(),
        branches: |point, view| vec![mirrored(point, view), straight(view)],
        transmissions: 2,
        ..SPREAD
    });
}

#[test]
#[should_panic(expected = "the normal of a lobe must be on the side")]
fn a_lobe_on_the_wrong_side_is_found() {
    material_laws(&Made {
        lobes: all(),
        branches: |point, view| vec![mirrored(point, view), straight(view)],
        transmissions: 2,
        side: |_| 1.0,
        ..SPREAD
    });
}

#[test]
#[should_panic(expected = "must declare its number of reflection rays")]
fn undeclared_reflection_rays_are_found() {
    material_laws(&Made {
        lobes: all(),
        reflections: 1,
        ..SPREAD
    });
}

#[test]
#[should_panic(expected = "unit directions")]
fn a_long_direction_is_found() {
    material_laws(&Made {
        lobes: all(),
        lobe: const { &[DVec3::new(0.6, 0.0, 0.81)] },
        ..SPREAD
    });
}

#[test]
fn a_lambertian_material_conserves_energy_and_is_reciprocal() {
    let right = Made {
        local: |point, view, light| std::f64::consts::FRAC_1_PI * lambert(point, view, light),
        ..RIGHT
    };
    energy_laws(&right);
    reciprocity_laws(&right);
}

#[test]
#[should_panic(expected = "at most the arriving light")]
fn a_missing_pi_is_found() {
    energy_laws(&RIGHT);
}

#[test]
#[should_panic(expected = "must be reciprocal")]
fn a_highlight_that_is_not_reciprocal_is_found() {
    reciprocity_laws(&Made {
        local: |point, view, light| lambert(point, view, light) * (2.0 + point.n_towards(view).dot(view)),
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "finite and not negative")]
fn an_unclamped_cosine_is_found() {
    material_laws(&Made {
        local: |point, view, light| {
            let n = point.n_towards(view);
            light
                .lights
                .iter()
                .map(|light| (n.dot(light.direction) - 0.5) / n.dot(view))
                .sum()
        },
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "both sides must respond equally")]
fn a_dark_inside_is_found() {
    material_laws(&Made {
        local: |point, view, light| {
            if point.n_g.dot(view) > 0.0 {
                lambert(point, view, light)
            } else {
                0.0
            }
        },
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "must declare that it needs it")]
fn an_undeclared_shading_normal_is_found() {
    material_laws(&Made {
        needs: SurfaceAttributes::NOTHING,
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "local radiance without light")]
fn a_glow_is_found() {
    material_laws(&Made {
        local: |_, _, _| 1.0,
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "proportional to the light")]
fn a_response_that_is_not_linear_is_found() {
    material_laws(&Made {
        local: |p, v, l| lambert(p, v, l).sqrt(),
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "must declare every kind")]
fn an_undeclared_specular_ray_is_found() {
    material_laws(&Made {
        branches: |point, view| vec![mirrored(point, view)],
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "must declare local illumination")]
fn an_undeclared_local_response_is_found() {
    material_laws(&Made {
        lobes: BsdfFlags::REFLECTION,
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "unit directions")]
fn a_long_specular_direction_is_found() {
    let branches = |point: &SurfaceInteraction, view| {
        let branch = mirrored(point, view);
        vec![SpecularRay {
            direction: branch.direction * 1.001,
            ..branch
        }]
    };
    material_laws(&Made {
        lobes: all(),
        branches,
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "must stay on the viewer's side")]
fn a_reflection_into_the_surface_is_found() {
    let branches = |point: &SurfaceInteraction, view| {
        let branch = mirrored(point, view);
        vec![SpecularRay {
            direction: -branch.direction,
            ..branch
        }]
    };
    material_laws(&Made {
        lobes: all(),
        branches,
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "at most the arriving radiance")]
fn a_surface_that_adds_energy_is_found() {
    let branches = |point: &SurfaceInteraction, view| vec![mirrored(point, view)];
    furnace_laws(&Made {
        lobes: all(),
        branches,
        ..RIGHT
    });
}

#[test]
#[should_panic(expected = "the law of refraction")]
fn glass_that_does_not_refract_is_found() {
    let branches = |point: &SurfaceInteraction, view| {
        let entering = point.n_g.dot(view) > 0.0;
        let weight = Rgb::splat(if entering { 1.0 / 2.25 } else { 2.25 });
        vec![SpecularRay {
            weight,
            ..straight(view)
        }]
    };
    dielectric_laws(
        &Made {
            lobes: all(),
            branches,
            ..RIGHT
        },
        1.5,
        1.0,
    );
}

#[test]
#[should_panic(expected = "energy must be conserved")]
fn glass_that_loses_light_is_found() {
    let branches = |point: &SurfaceInteraction, view| vec![mirrored(point, view)];
    dielectric_laws(
        &Made {
            lobes: all(),
            branches,
            ..RIGHT
        },
        1.5,
        1.0,
    );
}
