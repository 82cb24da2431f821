//! A pipe that closes when this process ends, in whatever way.

use std::io;
use std::process::{Child, Command};

/// The environment variable in which a child process finds its end of the pipe
/// (`references/protocol/whitstone_protocol/serve.py`).
#[cfg(target_os = "linux")]
const PARENT: &str = "WHITSTONE_PARENT";

/// The end of the pipe that only this process has.
pub(crate) struct Lifeline {
    #[cfg(target_os = "linux")]
    _end: io::PipeWriter,
}

/// Starts a driver that ends when the lifeline is dropped. Only on Linux can the system end it;
/// elsewhere it looks for its parent itself.
pub(crate) fn spawn(command: &mut Command) -> io::Result<(Child, Lifeline)> {
    #[cfg(target_os = "linux")]
    {
        use std::os::fd::AsRawFd;

        let (reader, writer) = io::pipe()?;
        // The child keeps it open. So does another program that is started at this moment, which
        // does no harm: only the driver asks for a signal.
        rustix::io::fcntl_setfd(&reader, rustix::io::FdFlags::empty())?;
        command.env(PARENT, reader.as_raw_fd().to_string());
        Ok((command.spawn()?, Lifeline { _end: writer }))
    }
    #[cfg(not(target_os = "linux"))]
    Ok((command.spawn()?, Lifeline {}))
}
