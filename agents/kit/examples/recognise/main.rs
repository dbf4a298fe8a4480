//! Measures how well goals are recognised among all things that a walk through a house has shown, by each perception of the
//! kit, and prints tables of docs/perception.md:
//!
//! ```sh
//! avln data dataset frames --measure --split val --houses 11 --views 60 --out FOLDER
//! cargo run --release -p avln-kit --example recognise -- FOLDER
//! ```

#[path = "../../../perception/examples/measure/frames.rs"]
mod frames;
mod tally;
mod truth;
mod walk;

use avln_kit::perception::{Classical, Recognition, Sight};
use std::path::PathBuf;
use tally::Tally;

fn main() {
    let Some(folder) = std::env::args().nth(1).map(PathBuf::from) else {
        eprintln!("name the folder that avln data dataset frames has written");
        std::process::exit(2);
    };
    let manifest = frames::manifest(&folder);
    let mut perceptions: [(&str, Box<dyn Recognition>); 2] = [
        ("depth and colours", Box::<Classical>::default()),
        ("network", Box::new(Sight::new().expect("the weights of the crate"))),
    ];
    let mut tallies = [Tally::default(), Tally::default()];
    for house in &manifest.houses {
        let records = frames::house(&folder.join(&house.file), manifest.side_px);
        let sentences = frames::sentences(&folder.join(&house.sentences));
        let Some(walk) = walk::Walk::through(&records, &sentences, &manifest.categories, manifest.side_px)
        else {
            continue;
        };
        for ((_, perception), tally) in perceptions.iter_mut().zip(&mut tallies) {
            tally.add(&walk, &walk.objects(perception.as_mut()));
        }
    }
    println!(
        "{} houses of split `{}` of recipe `{}`.\n",
        manifest.houses.len(),
        manifest.split,
        manifest.recipe
    );
    tally::print(&perceptions.map(|(name, _)| name), &tallies);
}
