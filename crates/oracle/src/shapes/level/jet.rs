//! Numbers with their derivative along a line, and with their change for a relative change of one
//! of all constants of the shape.

use super::number::Number;

#[derive(Clone)]
pub(crate) struct Jet<N> {
    pub(crate) value: N,
    /// The derivative; Clarke's generalized one for a function with a crease. `None` if unknown.
    pub(crate) slope: Option<N>,
    /// The sum over the constants c of |df/dc c|: a bound of the change with the worst signs.
    pub(crate) moves: f64,
}

impl<N: Number> Jet<N> {
    /// A number that is constant along the line and is no parameter of the shape.
    pub(crate) fn exact(value: N) -> Self {
        let zero = value.like(0.0);
        Self {
            value,
            slope: Some(zero),
            moves: 0.0,
        }
    }

    /// The parameter of the line.
    pub(crate) fn variable(value: N) -> Self {
        let one = value.like(1.0);
        Self {
            value,
            slope: Some(one),
            moves: 0.0,
        }
    }

    /// A parameter of the shape.
    pub(crate) fn constant(&self, x: f64) -> Self {
        Self {
            moves: x.abs(),
            ..self.number(x)
        }
    }

    /// A constant of the formula.
    pub(crate) fn number(&self, x: f64) -> Self {
        Self::exact(self.value.like(x))
    }

    fn size(&self) -> f64 {
        let [low, high] = self.value.ends();
        low.abs().max(high.abs())
    }

    pub(crate) fn plus(&self, other: &Self) -> Self {
        Self {
            value: self.value.plus(&other.value),
            slope: both(self, other).map(|[a, b]| a.plus(b)),
            moves: self.moves + other.moves,
        }
    }

    pub(crate) fn negated(&self) -> Self {
        Self {
            value: self.value.negated(),
            slope: self.slope.as_ref().map(N::negated),
            moves: self.moves,
        }
    }

    pub(crate) fn minus(&self, other: &Self) -> Self {
        self.plus(&other.negated())
    }

    pub(crate) fn times(&self, other: &Self) -> Self {
        let slopes = both(self, other);
        Self {
            value: self.value.times(&other.value),
            slope: slopes.map(|[a, b]| a.times(&other.value).plus(&self.value.times(b))),
            moves: self.moves * other.size() + self.size() * other.moves,
        }
    }

    pub(crate) fn squared(&self) -> Self {
        let twice = self.value.plus(&self.value);
        Self {
            value: self.value.squared(),
            slope: self.slope.as_ref().map(|slope| slope.times(&twice)),
            moves: 2.0 * self.size() * self.moves,
        }
    }

    /// The quotient; `None` if the divisor may be zero.
    pub(crate) fn over(&self, other: &Self) -> Option<Self> {
        let one = other.value.like(1.0);
        let inverse = one.divided(&other.value)?;
        let square = inverse.squared();
        let [low, high] = inverse.ends();
        let size = low.abs().max(high.abs());
        Some(self.times(&Self {
            slope: other.slope.as_ref().map(|slope| slope.times(&square).negated()),
            moves: other.moves * size * size,
            value: inverse,
        }))
    }

    /// The square root of a number that is not negative.
    pub(crate) fn root(&self) -> Self {
        let value = self.value.root();
        let twice = value.plus(&value);
        let slope = self.slope.as_ref().and_then(|slope| slope.divided(&twice));
        let [low, _] = twice.ends();
        Self {
            value,
            slope,
            moves: if self.moves == 0.0 { 0.0 } else { self.moves / low },
        }
    }

    /// The minimum of both.
    pub(crate) fn min(&self, other: &Self) -> Self {
        let apart = self.value.plus(&other.value.negated());
        if !apart.has_zero() {
            return if apart.is_above() {
                other.clone()
            } else {
                self.clone()
            };
        }
        Self {
            value: self.value.min(&other.value),
            slope: both(self, other).map(|[a, b]| a.hull(b)),
            moves: self.moves.max(other.moves),
        }
    }

    pub(crate) fn max(&self, other: &Self) -> Self {
        self.negated().min(&other.negated()).negated()
    }

    pub(crate) fn abs(&self) -> Self {
        self.max(&self.negated())
    }

    /// Clamped to [0, 1].
    pub(crate) fn clamped(&self) -> Self {
        self.max(&self.number(0.0)).min(&self.number(1.0))
    }

    /// Cosine and sine of an angle in degrees.
    pub(crate) fn turn(&self) -> [Self; 2] {
        let [cos, sin] = self.value.turn();
        let speed = self.slope.as_ref().map(N::radians);
        let along = |factor: N| speed.as_ref().map(|speed| speed.times(&factor));
        let slopes = [along(sin.negated()), along(cos.clone())];
        let [c, s] = slopes;
        let moves = self.moves.to_radians();
        [
            Self {
                value: cos,
                slope: c,
                moves,
            },
            Self {
                value: sin,
                slope: s,
                moves,
            },
        ]
    }

    pub(crate) fn dot(a: &[Self; 3], b: &[Self; 3]) -> Self {
        let [x, y, z] = [0, 1, 2].map(|axis| a[axis].times(&b[axis]));
        x.plus(&y).plus(&z)
    }

    pub(crate) fn length(v: &[Self; 3]) -> Self {
        let [x, y, z] = v.each_ref().map(Self::squared);
        x.plus(&y).plus(&z).root()
    }
}

fn both<'a, N>(a: &'a Jet<N>, b: &'a Jet<N>) -> Option<[&'a N; 2]> {
    Some([a.slope.as_ref()?, b.slope.as_ref()?])
}
