//! Sends pictures to the viewer tev, by its interface for other programs.
//!
//! A packet is its length in bytes (with the length itself), its type and its contents; numbers are
//! little-endian, texts end in a zero, and a truth value is a byte. The interface is described in
//! tev's documentation ("Inter-process communication") and in its `include/tev/Ipc.h`.

use std::io::{self, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// Packet types.
const CREATE_IMAGE: u8 = 4;
const UPDATE_IMAGE: u8 = 6;

/// Channels, in the order of a pixel.
const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// Time limit for connecting and for each write.
const PATIENCE: Duration = Duration::from_secs(2);

/// A connection to tev.
pub(crate) struct Tev {
    address: String,
    stream: Option<TcpStream>,
    /// The size of the image that tev has.
    size: Option<[u32; 2]>,
}

impl Tev {
    /// A viewer at `HOST:PORT`, to which nothing is sent yet.
    pub(crate) fn new(address: &str) -> Self {
        Self {
            address: address.to_owned(),
            stream: None,
            size: None,
        }
    }

    /// Shows a picture under a name. Connects if there is no connection.
    ///
    /// # Errors
    /// If tev cannot be reached; the next call tries again.
    pub(crate) fn show(
        &mut self,
        name: &str,
        [width, height]: [u32; 2],
        pixels: &[[f32; 3]],
    ) -> io::Result<()> {
        let result = self.send(name, [width, height], pixels);
        if result.is_err() {
            self.stream = None;
            self.size = None;
        }
        result
    }

    fn send(&mut self, name: &str, size: [u32; 2], pixels: &[[f32; 3]]) -> io::Result<()> {
        let stream = match self.stream.take() {
            Some(stream) => stream,
            None => connect(&self.address)?,
        };
        let stream = self.stream.insert(stream);
        if self.size != Some(size) {
            stream.write_all(&create(name, size))?;
            self.size = Some(size);
        }
        stream.write_all(&update(name, size, pixels))
    }
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "the host has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => {
                stream.set_write_timeout(Some(PATIENCE))?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Checks the form `HOST:PORT`.
pub(crate) fn check(address: &str) -> Result<(), String> {
    let parts = address.rsplit_once(':');
    let fits =
        parts.is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0));
    fits.then_some(())
        .ok_or_else(|| format!("\"{address}\": expected HOST:PORT, such as 127.0.0.1:14158"))
}

/// A packet of a type.
fn packet(kind: u8, fill: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = vec![0; 4];
    bytes.push(kind);
    fill(&mut bytes);
    let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
    bytes[..4].copy_from_slice(&length.to_le_bytes());
    bytes
}

fn text(bytes: &mut Vec<u8>, text: &str) {
    bytes.extend(text.bytes().filter(|byte| *byte != 0));
    bytes.push(0);
}

fn whole(bytes: &mut Vec<u8>, number: u32) {
    bytes.extend(number.to_le_bytes());
}

fn channels(bytes: &mut Vec<u8>) {
    whole(bytes, CHANNELS.len() as u32);
    CHANNELS.iter().for_each(|name| text(bytes, name));
}

/// Creates an image, which gets the focus.
fn create(name: &str, [width, height]: [u32; 2]) -> Vec<u8> {
    packet(CREATE_IMAGE, |bytes| {
        bytes.push(1);
        text(bytes, name);
        whole(bytes, width);
        whole(bytes, height);
        channels(bytes);
    })
}

/// Replaces all pixels of an image; its channels are interleaved.
fn update(name: &str, [width, height]: [u32; 2], pixels: &[[f32; 3]]) -> Vec<u8> {
    packet(UPDATE_IMAGE, |bytes| {
        bytes.push(0);
        text(bytes, name);
        channels(bytes);
        [0, 0, width, height]
            .into_iter()
            .for_each(|number| whole(bytes, number));
        for offset in 0..CHANNELS.len() as i64 {
            bytes.extend(offset.to_le_bytes());
        }
        for _ in CHANNELS {
            bytes.extend((CHANNELS.len() as i64).to_le_bytes());
        }
        bytes.extend(pixels.as_flattened().iter().flat_map(|value| value.to_le_bytes()));
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::net::TcpListener;

    #[test]
    fn packets_have_the_documented_bytes() {
        let mut expected = vec![0; 4];
        expected.extend([4, 1]);
        expected.extend(b"a\0");
        expected.extend([2, 0, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0]);
        expected.extend(b"R\0G\0B\0");
        expected[0] = expected.len() as u8;
        assert_eq!(create("a", [2, 1]), expected);
        let sent = update("a", [2, 1], &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        let length = u32::from_le_bytes(sent[..4].try_into().unwrap());
        assert_eq!(length as usize, sent.len());
        // Header, name, channels, place and size, offsets, strides, pixels.
        assert_eq!(sent.len(), 6 + 2 + (4 + 6) + 16 + 24 + 24 + 24);
        assert_eq!(sent[sent.len() - 4..], 6.0_f32.to_le_bytes());
    }

    #[test]
    fn a_picture_is_created_once_and_then_updated() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut tev = Tev::new(&listener.local_addr().unwrap().to_string());
        for _ in 0..2 {
            tev.show("scene", [1, 1], &[[0.5; 3]]).unwrap();
        }
        drop(tev);
        let mut bytes = Vec::new();
        listener.accept().unwrap().0.read_to_end(&mut bytes).unwrap();
        let mut kinds = Vec::new();
        while !bytes.is_empty() {
            let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
            kinds.push(bytes[4]);
            bytes.drain(..length);
        }
        assert_eq!(kinds, [CREATE_IMAGE, UPDATE_IMAGE, UPDATE_IMAGE]);
    }

    #[test]
    fn a_viewer_that_is_not_there_is_an_error_and_asked_again() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        drop(listener);
        let mut tev = Tev::new(&address);
        assert!(tev.show("scene", [1, 1], &[[0.5; 3]]).is_err());
        let listener = TcpListener::bind(&address).unwrap();
        tev.show("scene", [1, 1], &[[0.5; 3]]).unwrap();
        drop(listener);
    }

    #[test]
    fn an_address_has_a_host_and_a_port() {
        for wrong in [
            "",
            "localhost",
            ":14158",
            "localhost:",
            "localhost:0",
            "localhost:99999",
        ] {
            assert!(check(wrong).is_err(), "{wrong}");
        }
        assert!(check("localhost:14158").is_ok() && check("[::1]:14158").is_ok());
    }
}
