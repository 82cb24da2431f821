// scenes/showcase/classic.toml in the language of POV-Ray 3.7, for `bench --povray`: the same shapes,
// camera, light, background and depth. POV-Ray differs in two ways: shadow rays pass through glass,
// and a light fades as 2 / (1 + (d / fade_distance)^2), which is the inverse square law at these
// distances.
#version 3.7;

global_settings {
  assumed_gamma 1.0
  // Camera rays count as the first level.
  max_trace_level 7
  // No branch is dropped for a low weight, as in Whitstone.
  adc_bailout 0
}

camera {
  location <0, 2, 6>
  up y
  // POV-Ray's coordinates are left-handed.
  right -x * image_width / image_height
  angle 45
  look_at <0, 1, 0>
}

light_source {
  <3, 5, 4>
  rgb 60 / pi / 2e-4
  fade_distance 0.01
  fade_power 2
}

background { rgb <0.05, 0.08, 0.12> }

default { finish { ambient 0 diffuse 1 } }

// The floor.
polygon {
  5, <-10, 0, -10>, <10, 0, -10>, <10, 0, 10>, <-10, 0, 10>, <-10, 0, -10>
  // The pattern has cells in all three dimensions; the floor must not lie on a boundary of cells.
  pigment { checker rgb 0.4, rgb 0.2 translate 0.5 * y }
}

// The mirror.
sphere {
  <-1.2, 1, 0>, 1
  pigment { rgb 0 }
  finish { diffuse 0 reflection 1 }
}

// The glass.
sphere {
  <1.2, 1, 0>, 1
  pigment { rgbt 1 }
  finish { diffuse 0 reflection { 0, 1 fresnel on } conserve_energy }
  interior { ior 1.5 }
}

// The matte ball.
sphere {
  <0, 0.5, 2>, 0.5
  pigment { rgb <0.8, 0.2, 0.2> }
}
