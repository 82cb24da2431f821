//! MTL files: statements of materials.

use super::decoded;
use crate::files::shorten;
use std::str::SplitAsciiWhitespace;

/// A material of an MTL file, as written.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Mtl {
    pub(super) name: String,
    /// `Kd`, albedo.
    pub(super) diffuse: Option<[f64; 3]>,
    /// `Ka`.
    pub(super) ambient: Option<[f64; 3]>,
    /// `Ks`.
    pub(super) specular: Option<[f64; 3]>,
    /// `Ke`.
    pub(super) emission: Option<[f64; 3]>,
    /// `Ns`.
    pub(super) exponent: Option<f64>,
    /// `Ni`.
    pub(super) ior: Option<f64>,
    /// `d`, or 1 - `Tr`.
    pub(super) opacity: Option<f64>,
    /// `Tf`.
    pub(super) filter: Option<[f64; 3]>,
    /// `illum`.
    pub(super) illum: Option<i64>,
    pub(super) diffuse_map: Option<Map>,
    pub(super) specular_map: Option<Map>,
    pub(super) emission_map: Option<Map>,
    pub(super) opacity_map: Option<Map>,
    pub(super) normal_map: Option<Map>,
    pub(super) bump_map: Option<Map>,
    /// Names of features that occur and are dropped or approximated.
    pub(super) noted: Vec<&'static str>,
}

/// A texture of a material, with its options.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Map {
    pub(super) file: String,
    /// Line of the MTL file, from 1.
    pub(super) line: usize,
    pub(super) scale: Option<[f64; 2]>,
    pub(super) offset: Option<[f64; 2]>,
    pub(super) clamp: bool,
    /// `-bm`.
    pub(super) multiplier: Option<f64>,
    /// `-imfchan`.
    pub(super) channel: Option<char>,
}

/// An error in an MTL file: line from 1, and message.
pub(super) type LineError = (usize, String);

/// The materials of a file, and all errors. Statements before the first `newmtl` are ignored.
pub(super) fn parse(bytes: &[u8]) -> (Vec<Mtl>, Vec<LineError>) {
    let mut materials: Vec<Mtl> = Vec::new();
    let mut errors = Vec::new();
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    for (number, line) in (1..).zip(bytes.split(|&byte| byte == b'\n')) {
        let text = decoded(line.trim_ascii());
        let keyword = text.split_ascii_whitespace().next().unwrap_or_default();
        let rest = text[keyword.len()..].trim_ascii();
        if keyword.eq_ignore_ascii_case("newmtl") {
            materials.push(Mtl {
                name: rest.to_owned(),
                ..Mtl::default()
            });
        } else if let Some(material) = materials.last_mut()
            && let Err(message) = material.statement(&keyword.to_ascii_lowercase(), rest, number)
        {
            errors.push((number, message));
        }
    }
    (materials, errors)
}

impl Mtl {
    /// All textures of the material.
    pub(super) fn maps_mut(&mut self) -> [&mut Option<Map>; 6] {
        [
            &mut self.diffuse_map,
            &mut self.specular_map,
            &mut self.emission_map,
            &mut self.opacity_map,
            &mut self.normal_map,
            &mut self.bump_map,
        ]
    }

    fn statement(&mut self, keyword: &str, rest: &str, line: usize) -> Result<(), String> {
        // A name may contain `#`, a number may not.
        let numbers = rest.split('#').next().unwrap_or_default();
        match keyword {
            "kd" => self.diffuse = self.color(numbers)?.or(self.diffuse),
            "ka" => self.ambient = self.color(numbers)?.or(self.ambient),
            "ks" => self.specular = self.color(numbers)?.or(self.specular),
            "ke" => self.emission = self.color(numbers)?.or(self.emission),
            "tf" => self.filter = self.color(numbers)?.or(self.filter),
            "ns" => self.exponent = Some(one_number(numbers)?),
            "ni" => self.ior = Some(one_number(numbers)?),
            "d" => {
                let numbers = match numbers.trim().strip_prefix("-halo") {
                    Some(rest) => {
                        self.note("d -halo");
                        rest
                    }
                    None => numbers,
                };
                self.opacity = Some(self.fraction(numbers)?);
            }
            // `d` has priority.
            "tr" => {
                let transparency = self.fraction(numbers)?;
                self.opacity = self.opacity.or(Some(1.0 - transparency));
            }
            "illum" => {
                let word = numbers.split_ascii_whitespace().next().unwrap_or_default();
                let model = word.parse();
                self.illum =
                    Some(model.map_err(|_| {
                        format!("expected a number from 0 to 10, found \"{}\"", shorten(word))
                    })?);
            }
            "map_kd" => self.diffuse_map = self.map(rest, line)?.or(self.diffuse_map.take()),
            "map_ks" => self.specular_map = self.map(rest, line)?.or(self.specular_map.take()),
            "map_ke" | "map_emissive" => {
                self.emission_map = self.map(rest, line)?.or(self.emission_map.take())
            }
            "map_d" | "map_opacity" => self.opacity_map = self.map(rest, line)?.or(self.opacity_map.take()),
            "norm" | "map_kn" => self.normal_map = self.map(rest, line)?.or(self.normal_map.take()),
            "bump" | "map_bump" => self.bump_map = self.map(rest, line)?.or(self.bump_map.take()),
            "map_ka" => self.note("map_Ka"),
            "map_ns" => self.note("map_Ns"),
            "map_tr" => self.note("map_Tr"),
            "disp" | "map_disp" => self.note("disp"),
            "decal" => self.note("decal"),
            "refl" | "map_refl" => self.note("refl"),
            "sharpness" => self.note("sharpness"),
            "map_aat" => self.note("map_aat"),
            "pr" | "pm" | "ps" | "pc" | "pcr" | "aniso" | "anisor" | "map_pr" | "map_pm" | "map_ps"
            | "map_pc" => {
                self.note("Pr, Pm, Ps, Pc, Pcr, aniso, anisor");
            }
            _ if keyword.is_empty() || keyword.starts_with('#') => {}
            _ => self.note("other statements"),
        }
        Ok(())
    }

    fn note(&mut self, feature: &'static str) {
        if !self.noted.contains(&feature) {
            self.noted.push(feature);
        }
    }

    /// A number >= 0 that is limited to 1.
    fn fraction(&mut self, text: &str) -> Result<f64, String> {
        let value = positive(&mut text.split_ascii_whitespace())?;
        if value > 1.0 {
            self.note("d, Tr above 1");
        }
        Ok(value.min(1.0))
    }

    /// A colour of one or three numbers; none if it is given in another way, which is noted.
    fn color(&mut self, text: &str) -> Result<Option<[f64; 3]>, String> {
        let mut words = text.split_ascii_whitespace();
        if matches!(words.clone().next(), Some("spectral" | "xyz")) {
            self.note("spectral, xyz");
            return Ok(None);
        }
        let first = positive(&mut words)?;
        let Some(word) = words.next() else {
            return Ok(Some([first; 3]));
        };
        let second = nonnegative(word)?;
        Ok(Some([first, second, positive(&mut words)?]))
    }

    /// A texture; none if it has no file, which is noted.
    fn map(&mut self, text: &str, line: usize) -> Result<Option<Map>, String> {
        let mut map = Map {
            line,
            ..Map::default()
        };
        let mut rest = text.trim();
        while rest.starts_with('-') {
            let (option, after) = word(rest);
            rest = after;
            match option.to_ascii_lowercase().as_str() {
                "-s" => map.scale = Some(pair(&mut rest, 1.0)?),
                "-o" => map.offset = Some(pair(&mut rest, 0.0)?),
                "-t" => {
                    pair(&mut rest, 0.0)?;
                    self.note("-t");
                }
                "-clamp" => map.clamp = next(&mut rest) == "on",
                "-bm" => map.multiplier = Some(number(next(&mut rest))?),
                "-imfchan" => {
                    map.channel = next(&mut rest).chars().next();
                    if matches!(map.channel, Some('l' | 'z')) {
                        self.note("-imfchan l, z");
                    }
                }
                "-mm" => {
                    number(next(&mut rest))?;
                    number(next(&mut rest))?;
                    self.note("-mm");
                }
                "-boost" => {
                    number(next(&mut rest))?;
                    self.note("-boost");
                }
                "-texres" => {
                    next(&mut rest);
                    self.note("-texres");
                }
                "-blendu" | "-blendv" => {
                    next(&mut rest);
                    self.note("-blendu, -blendv");
                }
                "-cc" => {
                    next(&mut rest);
                    self.note("-cc");
                }
                "-type" => {
                    next(&mut rest);
                }
                _ => {
                    rest = after_arguments(rest)
                        .ok_or_else(|| format!("unknown option {} of a texture", shorten(option)))?;
                    self.note("other options of a texture");
                }
            }
        }
        if rest.is_empty() {
            self.note("map without a file name");
            return Ok(None);
        }
        map.file = rest.to_owned();
        Ok(Some(map))
    }
}

/// The text after the arguments of an unknown option: numbers, `on` and `off`. None if they might
/// be others: what follows is neither an option nor one word, the file name.
fn after_arguments(mut rest: &str) -> Option<&str> {
    loop {
        let (first, after) = word(rest);
        if first.starts_with('-') && number(first).is_err() || after.is_empty() {
            return Some(rest);
        }
        if !matches!(first, "on" | "off") && number(first).is_err() {
            return None;
        }
        rest = after;
    }
}

/// The first word and the text after it.
fn word(text: &str) -> (&str, &str) {
    let text = text.trim_start();
    let end = text.find(|c: char| c.is_ascii_whitespace()).unwrap_or(text.len());
    (&text[..end], text[end..].trim_start())
}

/// Takes the first word.
fn next<'a>(rest: &mut &'a str) -> &'a str {
    let (first, after) = word(rest);
    *rest = after;
    first
}

/// Takes one to three numbers, of which the third has no effect, and leaves at least one word.
fn pair(rest: &mut &str, default: f64) -> Result<[f64; 2], String> {
    let mut values = [number(next(rest))?, default];
    for place in 1..3 {
        let (first, after) = word(rest);
        let Ok(value) = number(first) else { break };
        if after.is_empty() {
            break;
        }
        *rest = after;
        if place == 1 {
            values[1] = value;
        }
    }
    Ok(values)
}

fn one_number(text: &str) -> Result<f64, String> {
    number(text.split_ascii_whitespace().next().unwrap_or_default())
}

fn positive(words: &mut SplitAsciiWhitespace<'_>) -> Result<f64, String> {
    nonnegative(words.next().unwrap_or_default())
}

fn nonnegative(word: &str) -> Result<f64, String> {
    let value = number(word)?;
    if value < 0.0 {
        return Err(format!("expected a number >= 0, found {word}"));
    }
    Ok(value)
}

/// A finite number.
fn number(word: &str) -> Result<f64, String> {
    let value = word.parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| match word {
        "" => "expected a number, found none".to_owned(),
        _ => format!("expected a finite number, found \"{}\"", shorten(word)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_are_read() {
        let text = "# x\nKd 1 1 1\nnewmtl a b\r\nKd 0.1 0.2 0.3 # red\nKs 0.5\nNs 90\nillum 2\nTr 0.25\n\
                    map_Kd -s 2 3 1 -o 0.5 -clamp on -mm 0 1 my file.png\nKd spectral x.rfl\n\
                    newmtl c\nd 0.5\nTr 0.9\nbump -bm 2 h.png\nnorm -bm 0.5 n.png\n";
        let (materials, errors) = parse(text.as_bytes());
        assert_eq!(errors, []);
        let [first, second] = &materials[..] else { panic!() };
        assert_eq!(first.name, "a b");
        assert_eq!(first.diffuse, Some([0.1, 0.2, 0.3]));
        assert_eq!(first.specular, Some([0.5; 3]));
        assert_eq!(first.opacity, Some(0.75));
        let map = first.diffuse_map.as_ref().unwrap();
        assert_eq!(
            (map.file.as_str(), map.scale, map.offset, map.clamp, map.line),
            ("my file.png", Some([2.0, 3.0]), Some([0.5, 0.0]), true, 9)
        );
        assert_eq!(first.noted, ["-mm", "spectral, xyz"]);
        assert_eq!(second.opacity, Some(0.5));
        assert_eq!(second.bump_map.as_ref().unwrap().multiplier, Some(2.0));
        assert_eq!(second.normal_map.as_ref().unwrap().multiplier, Some(0.5));
    }

    #[test]
    fn statements_and_options_without_effect_are_noted() {
        let noted = |text: &str| {
            let (materials, errors) = parse(format!("newmtl a\n{text}").as_bytes());
            assert_eq!(errors, []);
            materials[0].clone()
        };
        for keyword in ["map_Kd", "map_Ks", "map_Ke", "map_d", "norm", "map_Bump -bm 2"] {
            let found = noted(keyword);
            assert_eq!(found.noted, ["map without a file name"], "{keyword}");
        }
        let kept = noted("map_Kd a.png\nmap_Kd\n").diffuse_map.unwrap();
        assert_eq!(kept.file, "a.png");
        for (options, scale) in [
            ("-zz", None),
            ("-zz 1 -2.5 off", None),
            ("-zz -s 2 3", Some([2.0, 3.0])),
            ("-zz 4 -s 2 3", Some([2.0, 3.0])),
        ] {
            let found = noted(&format!("map_Kd {options} a.png"));
            assert_eq!(found.noted, ["other options of a texture"], "{options}");
            let map = found.diffuse_map.unwrap();
            assert_eq!((map.file.as_str(), map.scale), ("a.png", scale), "{options}");
        }
        let opaque = noted("d 1.0000001\n");
        assert_eq!(
            (opaque.opacity, &opaque.noted[..]),
            (Some(1.0), &["d, Tr above 1"][..])
        );
    }

    #[test]
    fn all_errors_are_reported_with_their_lines() {
        let text =
            "newmtl a\nKd x\nKs 1 -1 1\nNs nan\nd -2\nillum two\nmap_Kd -zz my file.png\nTr x\nKe 1 1\nNi\n";
        let (_, errors) = parse(text.as_bytes());
        let lines: Vec<usize> = errors.iter().map(|(line, _)| *line).collect();
        assert_eq!(lines, [2, 3, 4, 5, 6, 7, 8, 9, 10]);
        assert_eq!(errors[0].1, "expected a finite number, found \"x\"");
    }
}
