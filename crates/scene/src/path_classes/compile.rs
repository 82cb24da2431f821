//! Compiles path expressions to one automaton.
//!
//! The syntax is that of section 11 of `docs/whitted-model.md`, a part of the syntax of `regex`, on
//! the letters of the events. Only the states that a path can reach are kept.

use super::Expression;
use regex_automata::dfa::{Automaton, StartKind, dense};
use regex_automata::nfa::thompson;
use regex_automata::util::primitives::StateID;
use regex_automata::util::start;
use regex_automata::{Anchored, MatchKind};
use regex_syntax::ParserBuilder;
use regex_syntax::hir::{Hir, Look};
use std::collections::HashMap;
use whitstone_core::{
    BRANCH_EVENTS, PathClassState, PathClasses, PathEnd, SceneError, SceneErrors, SourceSpan,
};

/// The letters of the events.
const EVENTS: &str = "ESGTDLAOB";
/// The characters that operators consist of.
const OPERATORS: &str = "()[]^|*+?{},0123456789.";
/// Maximum count of a repetition.
const MAX_COUNT: u32 = 100;
/// Maximum number of classes.
const MAX_CLASSES: usize = 64;
/// Maximum memory of the automaton before it is reduced to the paths, in bytes. One million steps
/// of repetition do not fit; expressions that people write take a few hundred bytes.
const MAX_BYTES: usize = 1 << 20;

impl Expression {
    /// The place of a part of the text, or of all of it if it is not written literally, but with
    /// escape sequences or in several lines.
    fn place(&self, start: usize, end: usize) -> SourceSpan {
        if self.span.len() == self.text.len() + 2 {
            // A quote is before it.
            self.span.start + 1 + start..self.span.start + 1 + end
        } else {
            self.span.clone()
        }
    }

    /// The error of a character that has no meaning in expressions.
    fn unknown(&self, at: usize, found: char) -> SceneError {
        let place = self.place(at, at + found.len_utf8());
        let events = EVENTS.split("").collect::<Vec<_>>().join(" ");
        let message = format!("expected an event, one of{events}or an operator, found \"{found}\"");
        let instead = match found.to_ascii_uppercase() {
            'C' => 'E',
            'R' => 'S',
            upper => upper,
        };
        let error = SceneError::at(place, message);
        if EVENTS.contains(instead) {
            let help = format!("did you mean \"{instead}\"?");
            return error.with_help(help);
        }
        error
    }

    fn parse(&self) -> Result<Hir, SceneError> {
        let known = |c: char| EVENTS.contains(c) || OPERATORS.contains(c) || c.is_ascii_whitespace();
        if let Some((at, found)) = self.text.char_indices().find(|(_, c)| !known(*c)) {
            return Err(self.unknown(at, found));
        }
        // All numbers are counts.
        let numbers = self.text.split(|c: char| !c.is_ascii_digit());
        let large = numbers
            .filter(|digits| !digits.is_empty())
            .find(|digits| digits.parse().map_or(true, |count: u32| count > MAX_COUNT));
        if let Some(digits) = large {
            // The number is a part of the text.
            let at = digits.as_ptr() as usize - self.text.as_ptr() as usize;
            let message = format!("expected a count from 0 to {MAX_COUNT}, found {digits}");
            return Err(SceneError::at(self.place(at, at + digits.len()), message));
        }
        let mut parser = ParserBuilder::new();
        parser.ignore_whitespace(true).unicode(false).utf8(false);
        let parsed = parser.build().parse(&self.text);
        let hir = parsed.map_err(|error| {
            let (span, message) = match &error {
                regex_syntax::Error::Parse(error) => (error.span(), error.kind().to_string()),
                regex_syntax::Error::Translate(error) => (error.span(), error.kind().to_string()),
                // The type is not exhaustive.
                _ => return SceneError::at(self.span.clone(), error.to_string()),
            };
            let place = self.place(span.start.offset, span.end.offset);
            SceneError::at(place, format!("this path expression does not parse: {message}"))
        })?;
        // The expression is that of whole paths.
        Ok(Hir::concat(vec![hir, Hir::look(Look::End)]))
    }
}

/// The automaton of all classes.
pub(crate) fn compile(expressions: &[Expression]) -> Result<PathClasses, SceneErrors> {
    let mut errors = SceneErrors::default();
    if let Some(beyond) = expressions.get(MAX_CLASSES) {
        let message = format!(
            "expected at most {MAX_CLASSES} path classes, found {}",
            expressions.len()
        );
        return Err(SceneError::at(beyond.span.clone(), message).into());
    }
    let parsed = expressions.iter().filter_map(|expression| {
        let hir = expression.parse().map_err(SceneErrors::from);
        Some((expression, errors.take(hir)?))
    });
    let parsed: Vec<_> = parsed.collect();
    for (expression, hir) in &parsed {
        // Alone, so that the error names the expression that is too large.
        if automaton(&[hir]).is_none() {
            let message = "this path expression is too large";
            let error = SceneError::at(expression.span.clone(), message);
            errors.0.push(error.with_help("decrease its repetitions"));
        }
    }
    if !errors.0.is_empty() {
        return Err(errors);
    }
    let hirs: Vec<&Hir> = parsed.iter().map(|(_, hir)| hir).collect();
    let states = automaton(&hirs);
    let too_large = || SceneError::anywhere("the path classes together are too large");
    let states = states.ok_or_else(|| match expressions.first() {
        Some(first) => SceneErrors::from(too_large()).or_at(&first.span),
        None => too_large().into(),
    })?;
    for (expression, number) in expressions.iter().zip(0..) {
        let mut ends = states.iter().flat_map(|state| state.ends.iter().flatten());
        if !ends.any(|class| *class == number) {
            let error = SceneError::at(expression.span.clone(), "no path matches this expression");
            let help = "a path is E, then any number of S, G and T, then D L, D A, O or B";
            errors.0.push(error.with_help(help));
        }
    }
    errors.into_result(PathClasses {
        names: expressions
            .iter()
            .map(|expression| expression.name.clone())
            .collect(),
        states,
    })
}

/// The states that paths reach, the camera ray's first; `None` if there are too many.
fn automaton(hirs: &[&Hir]) -> Option<Vec<PathClassState>> {
    let nfa = thompson::Config::new()
        .utf8(false)
        .nfa_size_limit(Some(MAX_BYTES));
    let nfa = thompson::Compiler::new()
        .configure(nfa)
        .build_many_from_hir(hirs)
        .ok()?;
    let limits = dense::Config::new()
        .match_kind(MatchKind::All)
        .start_kind(StartKind::Anchored)
        .dfa_size_limit(Some(MAX_BYTES))
        .determinize_size_limit(Some(MAX_BYTES));
    let dfa = dense::Builder::new()
        .configure(limits)
        .build_from_nfa(&nfa)
        .ok()?;
    let start = dfa
        .start_state(&start::Config::new().anchored(Anchored::Yes))
        .ok()?;
    let camera = dfa.next_state(start, b'E');
    let mut numbers = HashMap::from([(camera, 0)]);
    let mut found = vec![camera];
    let mut states = Vec::new();
    while let Some(&from) = found.get(states.len()) {
        let next = BRANCH_EVENTS.map(|event| {
            let next = dfa.next_state(from, event as u8);
            let new = found.len() as u32;
            *numbers.entry(next).or_insert_with(|| {
                found.push(next);
                new
            })
        });
        let ends = PathEnd::ALL.map(|end| matches(&dfa, from, end.events()));
        states.push(PathClassState { next, ends });
    }
    Some(states)
}

/// The classes of the paths that go on with these last events.
fn matches(dfa: &impl Automaton, from: StateID, events: &str) -> Vec<u32> {
    let last = events
        .bytes()
        .fold(from, |state, event| dfa.next_state(state, event));
    let end = dfa.next_eoi_state(last);
    if !dfa.is_match_state(end) {
        return Vec::new();
    }
    let classes = (0..dfa.match_len(end)).map(|index| dfa.match_pattern(end, index).as_u32());
    let mut classes: Vec<u32> = classes.collect();
    classes.sort_unstable();
    classes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn expressions(list: &[(&str, &str)]) -> Vec<Expression> {
        list.iter()
            .map(|(name, text)| Expression {
                name: (*name).to_owned(),
                text: (*text).to_owned(),
                span: 100..102 + text.len(),
            })
            .collect()
    }

    /// The classes of a path.
    fn classes_of(classes: &PathClasses, path: &str) -> Vec<u32> {
        let end = PathEnd::ALL
            .into_iter()
            .find(|end| path.ends_with(end.events()))
            .unwrap();
        let branches = path
            .strip_suffix(end.events())
            .unwrap()
            .strip_prefix('E')
            .unwrap();
        let state = branches.chars().fold(0, |state: u32, event| {
            let event = BRANCH_EVENTS.iter().position(|letter| *letter == event).unwrap();
            classes.states[state as usize].next[event]
        });
        classes.states[state as usize].ends[end as usize].clone()
    }

    #[test]
    fn paths_are_in_the_classes_that_match_them() {
        let list = [
            ("direct", "E D L"),
            ("mirrored", "E S+ D L"),
            ("caustic", "E .* T D [LA]"),
            ("rest", "E(S|G){2,3}[^DL]"),
            ("all", ".*"),
        ];
        let classes = compile(&expressions(&list)).unwrap();
        let found = |path| classes_of(&classes, path);
        assert_eq!(found("EDL"), [0, 4]);
        assert_eq!(found("ESSSSDL"), [1, 4]);
        assert_eq!(found("ESTDL"), [2, 4]);
        assert_eq!(found("ETDA"), [2, 4]);
        assert_eq!(found("ESGB"), [3, 4]);
        assert_eq!(found("ESGGO"), [3, 4]);
        assert_eq!(found("ESGGGO"), [4]);
        assert_eq!(found("EDA"), [4]);
        assert!(!classes.is_partition());
        assert_eq!(
            classes.channels()[..3],
            ["path.direct.R", "path.direct.G", "path.direct.B"]
        );
    }

    #[test]
    fn partitions_are_found() {
        let partition = |list: &[(&str, &str)]| compile(&expressions(list)).unwrap().is_partition();
        assert!(partition(&[("all", ".*")]));
        assert!(partition(&[
            ("direct", "E D."),
            ("shown", "E [OB]"),
            ("rest", "E [SGT]+.*")
        ]));
        // E S B is in two of them; E B is in none.
        assert!(!partition(&[
            ("direct", "E D."),
            ("shown", "E .*[OB]"),
            ("rest", "E [SGT]+.*")
        ]));
        assert!(!partition(&[
            ("direct", "E D."),
            ("shown", "E O"),
            ("rest", "E [SGT]+.*")
        ]));
    }

    #[test]
    fn faults_are_refused_at_their_places() {
        let refused = |text: &str| {
            let found = compile(&expressions(&[("one", "E D L"), ("two", text)]));
            let error = found.expect_err(text).0.remove(0);
            let span = error.span.unwrap();
            // A whole value has its quotes.
            let [start, end] = [span.start, span.end].map(|place| place.saturating_sub(101));
            (start, end, error.message, error.help)
        };
        let (start, end, message, help) = refused("E R* D L");
        assert_eq!((start, end), (2, 3));
        assert!(message.contains("found \"R\""), "{message}");
        assert_eq!(help.as_deref(), Some("did you mean \"S\"?"));
        assert_eq!(refused("E d L").3.as_deref(), Some("did you mean \"D\"?"));
        assert_eq!(refused("E é L").0, 2);
        for (text, start) in [
            ("E (D L", 2),
            ("E D) L", 3),
            ("* D L", 0),
            ("E [DL", 2),
            ("E S{3,1} B", 3),
        ] {
            let (at, _, message, _) = refused(text);
            assert_eq!(at, start, "{text}: {message}");
            assert!(message.contains("does not parse"), "{message}");
        }
        for text in ["", "E", "D L", "E D", "L D S E", "E S D L S", "E^ D L"] {
            assert!(refused(text).2.contains("no path matches"), "{text}");
        }
        assert!(refused("E ((S{100}){100}){100} B").2.contains("too large"));
        assert_eq!(refused("E S{3,101} B").0, 6);
        assert_eq!(refused("E S{99999999999} B").0, 4);
        // States that remember the last twenty events.
        assert!(refused("E .* S .{20} B").2.contains("too large"));
        let many: Vec<_> = (0..65).map(|_| ("a", "E B")).collect();
        assert!(compile(&expressions(&many)).is_err());
    }

    #[test]
    fn an_expression_with_escapes_is_marked_as_a_whole() {
        let mut list = expressions(&[("one", "E R")]);
        list[0].span = 7..20;
        assert_eq!(compile(&list).unwrap_err().0[0].span, Some(7..20));
    }

    proptest! {
        /// Against a second implementation: the classes of a path by backtracking.
        #[test]
        fn random_expressions_match_as_by_backtracking(
            text in "(E|\\.)?([SGT.]{1,2}[*+?]?){0,4}(D[LA.]|O|B|\\.)",
            path in "E[SGT]{0,6}(DL|DA|O|B)",
        ) {
            let list = expressions(&[("all", ".*"), ("one", text.as_str())]);
            let Ok(classes) = compile(&list) else { return Ok(()) };
            let expected: Vec<u32> = if backtracks(text.as_bytes(), path.as_bytes()) { vec![0, 1] } else { vec![0] };
            prop_assert_eq!(classes_of(&classes, &path), expected);
        }
    }

    /// Whether an expression of letters, `.` and repetitions of one of them matches a path.
    fn backtracks(text: &[u8], path: &[u8]) -> bool {
        let [first, rest @ ..] = text else {
            return path.is_empty();
        };
        let fits = |path: &[u8]| path.first().is_some_and(|event| *first == b'.' || event == first);
        match rest.first() {
            Some(b'?') => backtracks(&rest[1..], path) || (fits(path) && backtracks(&rest[1..], &path[1..])),
            Some(b'*') => backtracks(&rest[1..], path) || (fits(path) && backtracks(text, &path[1..])),
            Some(b'+') => {
                let mut more = path;
                while fits(more) {
                    more = &more[1..];
                    if backtracks(&rest[1..], more) {
                        return true;
                    }
                }
                false
            }
            _ => fits(path) && backtracks(rest, &path[1..]),
        }
    }
}
