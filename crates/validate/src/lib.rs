//! The validation harness: renders each scene with Whitstone and with a reference renderer,
//! compares the images, and explains or reports every pixel that differs.

pub mod conventions;
mod decoded;
pub mod driver;
pub mod environment;
pub mod explain;
pub mod exported;
pub mod floor;
pub mod hashed;
mod inexact;
mod judge;
mod judge_noisy;
mod key;
mod lifeline;
mod live;
pub mod matrix;
mod noisy;
pub mod opinion;
mod oracle;
mod pixels;
mod place;
mod povray_format;
mod protocol;
pub mod reduce;
mod reference;
pub mod renderer;
pub mod report;
mod result;
pub mod sensitivity;
mod shared;
mod stop;
pub mod stored;
pub mod subject;
mod tolerance;
pub mod tree;
mod vacuous;
mod validator;
mod variants;
mod verdict;

pub use decoded::decode_textures;
pub use environment::{Installation, REFERENCES, TARGET, dask_python};
pub use key::{find_scenes, quoted, scene_key, stored_folder};
pub use live::{Live, LiveError, hash_sources};
pub use noisy::Noisy;
pub use opinion::{Ask, OraclePolicy};
pub use pixels::Pictures;
pub use povray_format::PovRayFormat;
pub use renderer::Renderer;
pub use result::{
    CaseResult, Check, LayerResult, Provenance, Reference, Results, SkippedScene, Status, SubjectRun,
    Summary, WorstPixel, counted,
};
pub use stop::Stop;
pub use subject::Subject;
pub use validator::{Mode, NoLive, Options, Validator, flatten, flatten_sources};
pub use variants::Variants;
