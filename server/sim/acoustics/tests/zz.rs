mod common;
use common::*;
#[test]
fn zz() {
    let house = two_rooms(true);
    let source = house.source(&point(2.5,1.0,3.4));
    for i in 0..=97 { let s=i as f32/97.0; let (x,z)=(7.5-4.5*s, 3.0-1.8*s);
      let r=source.impulse_response(&listener(x,z,40.0));
      println!("{x:.3} {z:.3} {:.3} {:.2} {}  {:.1} {:.1} {:.1}", source.distance_m(&point(x,1.0,z)).unwrap(), energy_db(&r), lag_us(&r,100.0,1000.0), level_db(&r.left,250.0),level_db(&r.left,1000.0),level_db(&r.left,4000.0)); }
}
