//! Writes the generated assets to the folder given as the first argument.

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).expect("the first argument is a folder"));
    std::fs::create_dir_all(&folder)?;
    for (name, bytes) in whitstone_testkit::assets::generate() {
        println!("{}: {} bytes", folder.join(name).display(), bytes.len());
        std::fs::write(folder.join(name), bytes)?;
    }
    Ok(())
}
