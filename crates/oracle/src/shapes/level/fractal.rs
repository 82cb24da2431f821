//! Julia sets and Mandelbulbs: points whose iterates stay within 2 of the origin.

use super::jet::Jet;
use super::number::Number;
use super::{Level, LevelSet};
use serde::Deserialize;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Fractal {
    kind: Kind,
    #[serde(default = "eight")]
    depth: u32,
    #[serde(default)]
    w: f64,
    c: Option<[f64; 4]>,
    #[serde(default = "eight")]
    power: u32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    Julia,
    Mandelbulb,
}

fn eight() -> u32 {
    8
}

impl Fractal {
    pub(crate) fn shape(self) -> LevelSet<Self> {
        LevelSet(self)
    }

    fn julia<N: Number>(&self, p: &[Jet<N>; 3]) -> Jet<N> {
        let [x, y, z] = p.clone();
        let c = self.c.unwrap_or_default().map(|c| p[0].constant(c));
        let mut q = [x, y, z, p[0].constant(self.w)];
        let mut left = self.depth;
        loop {
            let [a, b, c2, d] = q.each_ref().map(Jet::squared);
            let others = b.plus(&c2).plus(&d);
            let beyond = a.plus(&others).minus(&p[0].number(4.0));
            // A point that has left the circle stays outside.
            if left == 0 || beyond.value.is_above() {
                return beyond;
            }
            left -= 1;
            let twice = q[0].plus(&q[0]);
            let [_, j, k, l] = q;
            q = [
                a.minus(&others),
                twice.times(&j),
                twice.times(&k),
                twice.times(&l),
            ];
            for (part, c) in q.iter_mut().zip(&c) {
                *part = part.plus(c);
            }
        }
    }

    fn mandelbulb<N: Number>(&self, p: &[Jet<N>; 3]) -> Jet<N> {
        let mut q = p.clone();
        let mut left = self.depth;
        loop {
            let [x, y, z] = q.each_ref().map(Jet::squared);
            let flat = x.plus(&y);
            let square = flat.plus(&z);
            let beyond = square.minus(&p[0].number(4.0));
            if left == 0 || beyond.value.is_above() {
                return beyond;
            }
            left -= 1;
            let [level, length] = [flat.root(), square.root()];
            let [x, y, z] = q;
            let around = power(&unit(&x, &y, &level), self.power);
            let down = power(&unit(&z, &level, &length), self.power);
            let mut size = length.clone();
            for _ in 1..self.power {
                size = size.times(&length);
            }
            let across = size.times(&down[1]);
            q = [
                across.times(&around[0]).plus(&p[0]),
                across.times(&around[1]).plus(&p[1]),
                size.times(&down[0]).plus(&p[2]),
            ];
        }
    }
}

/// Cosine and sine of the angle of (a, b), a vector of the given length.
fn unit<N: Number>(a: &Jet<N>, b: &Jet<N>, length: &Jet<N>) -> [Jet<N>; 2] {
    [a, b].map(|x| match x.over(length) {
        Some(part) => bounded(part),
        None => anything(x),
    })
}

/// Cosine and sine of n times the angle.
fn power<N: Number>(turn: &[Jet<N>; 2], n: u32) -> [Jet<N>; 2] {
    let mut all = turn.clone();
    for _ in 1..n {
        let [c, s] = &all;
        let cos = c.times(&turn[0]).minus(&s.times(&turn[1]));
        let sin = s.times(&turn[0]).plus(&c.times(&turn[1]));
        all = [bounded(cos), bounded(sin)];
    }
    all
}

/// Clamps the bounds of a number that is known to lie in [-1, 1].
fn bounded<N: Number>(mut x: Jet<N>) -> Jet<N> {
    let one = x.value.like(1.0);
    let below = x.value.min(&one);
    x.value = below.negated().min(&one).negated();
    x
}

/// The interval [-1, 1], for an unknown cosine or sine.
fn anything<N: Number>(like: &Jet<N>) -> Jet<N> {
    let one = like.value.like(1.0);
    Jet {
        value: one.hull(&one.negated()),
        slope: None,
        moves: f64::INFINITY,
    }
}

impl Level for Fractal {
    fn at<N: Number>(&self, p: &[Jet<N>; 3]) -> Jet<N> {
        match self.kind {
            Kind::Julia => self.julia(p),
            Kind::Mandelbulb => self.mandelbulb(p),
        }
    }

    fn bounds(&self) -> (Option<[DVec3; 2]>, Option<f64>) {
        (None, Some(2.0))
    }
}
