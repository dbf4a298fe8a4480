//! Census and digests of some procedural houses. Changes to the generator invalidate all earlier splits and must
//! be deliberate: `AVLN_BLESS=1 cargo test -p avln-houses --test all` rewrites the file; state the reason in the
//! changelog.

use avln_houses::{HouseOptions, Pool, house};
use avln_scene::{digest::digest, stats::census};
use std::path::Path;

fn line(pool: &str, seed: u64, storeys: u8) -> String {
    let pool_of = Pool::from_name(pool).expect("a pool");
    let options = HouseOptions { storeys: storeys..=storeys, pool: pool_of, ..HouseOptions::default() };
    let scene = house("golden", seed, &options);
    let census = census(&scene);
    let (rooms, objects, triangles) = (census.rooms, census.objects, scene.mesh.triangles.len());
    let digest = digest(&scene);
    format!("{pool} {seed}: {rooms} rooms on {storeys}, {objects} objects, {triangles} triangles, {digest}\n")
}

#[test]
fn houses_match_the_golden_digests() {
    let houses = [("train", 1), ("validation", 2), ("test", 3)];
    let found: String =
        houses.iter().flat_map(|&(pool, seed)| [1, 2].map(|storeys| line(pool, seed, storeys))).collect();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/houses.txt");
    if std::env::var_os("AVLN_BLESS").is_some() {
        std::fs::write(&path, &found).expect("writable");
    }
    let expected = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(found == expected, "{} contains\n{expected}\nbut the houses are\n{found}", path.display());
}
