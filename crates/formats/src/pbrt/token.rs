//! Tokens of pbrt files: quoted strings, words (names and numbers) and brackets.

use crate::files::shorten;

/// Longest string or word in bytes.
const MAX_TOKEN: usize = 1 << 16;

/// A place: a file of the import, line and column from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct At {
    /// Index into the files that were read; 0 is the imported one.
    pub(super) file: usize,
    pub(super) line: usize,
    pub(super) column: usize,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token {
    /// A string, without its quotes and with its escapes resolved.
    Text(String),
    /// A directive, a number, `true` or `false`.
    Word(String),
    Open,
    Close,
}

impl Token {
    /// The token for a message.
    pub(super) fn shown(&self) -> String {
        match self {
            Self::Text(text) => format!("the string \"{}\"", shorten(text)),
            Self::Word(word) => format!("`{}`", shorten(word)),
            Self::Open => "`[`".to_owned(),
            Self::Close => "`]`".to_owned(),
        }
    }
}

/// The tokens of one file.
pub(super) struct Lexer {
    text: Vec<u8>,
    place: usize,
    at: At,
}

impl Lexer {
    pub(super) fn new(text: Vec<u8>, file: usize) -> Self {
        let mut lexer = Self {
            text,
            place: 0,
            at: At {
                file,
                line: 1,
                column: 1,
            },
        };
        if lexer.text.starts_with(b"\xef\xbb\xbf") {
            lexer.place = 3;
        }
        lexer
    }

    /// The place of the next byte.
    pub(super) fn at(&self) -> At {
        self.at
    }

    fn peek(&self) -> Option<u8> {
        self.text.get(self.place).copied()
    }

    fn step(&mut self) -> Option<u8> {
        let byte = self.peek()?;
        self.place += 1;
        if byte == b'\n' {
            self.at.line += 1;
            self.at.column = 1;
        } else if byte & 0xc0 != 0x80 {
            // Columns count characters.
            self.at.column += 1;
        }
        Some(byte)
    }

    /// The next token and its place; `None` at the end. The error is a message.
    pub(super) fn next(&mut self) -> Result<Option<(Token, At)>, (At, String)> {
        loop {
            let at = self.at;
            let start = self.place;
            let Some(byte) = self.step() else {
                return Ok(None);
            };
            let token = match byte {
                b' ' | b'\n' | b'\t' | b'\r' => continue,
                b'#' => {
                    while self.peek().is_some_and(|byte| byte != b'\n' && byte != b'\r') {
                        self.step();
                    }
                    continue;
                }
                b'[' => Token::Open,
                b']' => Token::Close,
                b'"' => Token::Text(self.string(at)?),
                _ => {
                    while self.peek().is_some_and(|byte| {
                        !matches!(byte, b' ' | b'\n' | b'\t' | b'\r' | b'"' | b'[' | b']')
                    }) {
                        self.step();
                    }
                    let bytes = &self.text[start..self.place];
                    if bytes.len() > MAX_TOKEN {
                        return Err((at, "a word is too long".to_owned()));
                    }
                    match std::str::from_utf8(bytes) {
                        Ok(word) => Token::Word(word.to_owned()),
                        Err(_) => return Err((at, "the file is not text in UTF-8".to_owned())),
                    }
                }
            };
            return Ok(Some((token, at)));
        }
    }

    /// The rest of a string that began at `at`.
    fn string(&mut self, at: At) -> Result<String, (At, String)> {
        let mut bytes = Vec::new();
        loop {
            match self.step() {
                None => return Err((at, "the file ends inside a string".to_owned())),
                Some(b'"') => break,
                Some(b'\n') => return Err((at, "a string ends at the end of its line".to_owned())),
                Some(b'\\') => {
                    let here = self.at;
                    bytes.push(match self.step() {
                        Some(b'b') => 0x08,
                        Some(b'f') => 0x0c,
                        Some(b'n') => b'\n',
                        Some(b'r') => b'\r',
                        Some(b't') => b'\t',
                        Some(byte @ (b'\\' | b'\'' | b'"')) => byte,
                        _ => return Err((here, "unknown escape in a string".to_owned())),
                    });
                }
                Some(byte) => bytes.push(byte),
            }
            if bytes.len() > MAX_TOKEN {
                return Err((at, "a string is too long".to_owned()));
            }
        }
        String::from_utf8(bytes).map_err(|_| (at, "the file is not text in UTF-8".to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_have_places() {
        let text = "Shape \"a\\\"b\" # x [\n  [1 -2.5]\"float r\"3";
        let mut lexer = Lexer::new(text.as_bytes().to_vec(), 0);
        let mut found = Vec::new();
        while let Some((token, at)) = lexer.next().unwrap() {
            found.push((token, at.line, at.column));
        }
        let word = |text: &str| Token::Word(text.into());
        let expected = [
            (word("Shape"), 1, 1),
            (Token::Text("a\"b".into()), 1, 7),
            (Token::Open, 2, 3),
            (word("1"), 2, 4),
            (word("-2.5"), 2, 6),
            (Token::Close, 2, 10),
            (Token::Text("float r".into()), 2, 11),
            (word("3"), 2, 20),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn bad_strings_are_errors() {
        for text in ["\"a", "\"a\nb\"", "\"\\q\"", "\"\\", "\"\u{ff}\""] {
            let bytes: Vec<u8> = text.chars().map(|c| c as u8).collect();
            assert!(Lexer::new(bytes, 0).next().is_err(), "{text}");
        }
    }
}
