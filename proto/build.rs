//! Compiles the protocol without `protoc`: protox parses, prost generates, the descriptor set feeds reflection.

use std::{env, error::Error, fs, path::PathBuf};

const FILES: [&str; 5] = [
    "avln/v1/common.proto",
    "avln/v1/task.proto",
    "avln/v1/info.proto",
    "avln/v1/run.proto",
    "avln/v1/play.proto",
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=avln");
    let out = PathBuf::from(env::var("OUT_DIR")?);

    let mut compiler = protox::Compiler::new(["."])?;
    compiler.include_imports(true).include_source_info(true).open_files(FILES)?;
    fs::write(out.join("avln_descriptor.bin"), compiler.encode_file_descriptor_set())?;

    tonic_prost_build::configure()
        .bytes(".")
        .codec_path("crate::WholeCodec")
        .compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
