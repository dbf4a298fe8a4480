//! Sound in buildings: walls, doorways and unusual positions.

use crate::common::{
    building, energy_db, first_wave, lag_us, level_db, listener, opaque_rooms, point, two_rooms,
};
use avln_acoustics::{ImpulseResponse, Listener, SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S, Settings, Source};
use avln_geom::Point3;

/// A source in the first room, hidden from most of the second.
fn source_beside_the_door() -> Point3<f32> {
    point(2.5, 1.0, 3.4)
}

/// First sample within 20 dB of the peak, at the earlier ear.
fn onset(response: &ImpulseResponse) -> usize {
    let first = |ear: &[f32]| {
        let peak = ear.iter().fold(0.0_f32, |peak, tap| peak.max(tap.abs()));
        ear.iter().position(|tap| tap.abs() > 0.1 * peak).unwrap_or(usize::MAX)
    };
    first(&response.left).min(first(&response.right))
}

/// Energy at both ears before sample `end`, relative to the total, decibels.
fn early_db(response: &ImpulseResponse, end: usize) -> f64 {
    let cut = |ear: &[f32]| ear[..end.min(ear.len())].to_vec();
    energy_db(&ImpulseResponse { left: cut(&response.left), right: cut(&response.right) })
        - energy_db(response)
}

/// Shortest path through the door, around two jamb corners at z = 1.9, at constant height.
fn around_the_jamb_m(source: &Point3<f32>, listener: &Point3<f32>) -> f32 {
    let (near, far) = (point(4.0, 1.0, 1.9), point(4.2, 1.0, 1.9));
    let direct = |jamb: &Point3<f32>| (jamb - source).norm() + (listener - jamb).norm();
    let both = (near - source).norm() + 0.2 + (listener - far).norm();
    // If the line from a corner passes the other corner freely, only that corner bends the path.
    let slope_in = (1.9 - source.z) / (4.0 - source.x);
    let slope_out = (listener.z - 1.9) / (listener.x - 4.2);
    if slope_in >= 0.0 {
        direct(&near)
    } else if slope_out <= 0.0 {
        direct(&far)
    } else {
        both
    }
}

#[test]
fn path_through_a_door_is_the_shortest() {
    let house = two_rooms(true);
    let from = source_beside_the_door();
    let source = house.source(&from);
    for (x, z) in [(5.0, 3.0), (6.0, 3.5), (7.5, 2.2), (4.6, 3.7), (5.2, 2.4)] {
        let to = point(x, 1.0, z);
        let (expected, found) =
            (around_the_jamb_m(&from, &to), source.distance_m(&to).expect("through the door"));
        assert!((-0.005..0.04).contains(&(found - expected)), "({x}, {z}): {found} m, not {expected} m");
    }
}

#[test]
fn sound_arrives_from_the_door_on_time() {
    let house = opaque_rooms(true, first_wave());
    let source = house.source(&source_beside_the_door());
    for (x, z) in [(5.5, 3.0), (6.0, 3.5), (7.5, 3.6), (5.0, 3.2)] {
        let place = listener(x, z, 0.0);
        let response = source.impulse_response(&place);
        let way_m = around_the_jamb_m(&source_beside_the_door(), &place.position);
        let due = way_m / SPEED_OF_SOUND_M_S * SAMPLE_RATE_HZ as f32;
        let late = onset(&response) as f32 - due;
        // -0.3 to +1.0 ms; the nearer ear hears it 0.25 ms before the head's centre.
        assert!((-10.0..16.0).contains(&late), "({x}, {z}): {late} samples late");
        assert!(early_db(&response, due as usize - 24) < -60.0, "sound through the wall");
        assert!(door_is_ahead(&source, &place), "({x}, {z}): does not come from the door");
    }
}

/// Returns true if the sound comes from the doorway, within five degrees.
fn door_is_ahead(source: &Source, place: &Listener) -> bool {
    let azimuth_deg = |z: f32| {
        let offset = point(4.1, 1.0, z) - place.position;
        (-offset.x).atan2(-offset.z).to_degrees()
    };
    let (one, other) = (azimuth_deg(1.0), azimuth_deg(1.9));
    let side = |heading_deg: f32| {
        lag_us(
            &source.impulse_response(&listener(place.position.x, place.position.z, heading_deg)),
            100.0,
            1500.0,
        )
    };
    // Heading is positive to the left; for a source on the right, the left ear lags.
    side(one.min(other) - 5.0) < 0.0 && side(one.max(other) + 5.0) > 0.0
}

#[test]
fn walls_block_and_shadows_lose_high_frequencies() {
    let house = opaque_rooms(true, first_wave());
    let source = house.source(&point(3.6, 1.0, 3.4));
    let (this_side, other_side) = (listener(3.6, 2.4, 0.0), listener(4.6, 3.4, 0.0));
    let step =
        energy_db(&source.impulse_response(&this_side)) - energy_db(&source.impulse_response(&other_side));
    assert!(step >= 10.0, "only {step} dB across the wall");
    // Deeper shadows lose more high than low frequencies.
    let tilt = |x, z| {
        let response = source.impulse_response(&listener(x, z, 90.0));
        level_db(&response.left, 125.0) - level_db(&response.left, 2000.0)
    };
    assert!(tilt(4.6, 3.4) > tilt(6.0, 1.2) && tilt(6.0, 1.2) > tilt(7.0, 0.4) - 1.0);
}

#[test]
fn level_and_delay_are_smooth_past_a_doorway() {
    let house = opaque_rooms(true, first_wave());
    for from in [source_beside_the_door(), point(1.0, 1.2, 1.3), point(3.0, 0.6, 0.5)] {
        let source = house.source(&from);
        for walk in
            [along((5.0, 0.3), (5.0, 3.7)), along((7.5, 3.0), (3.0, 1.2)), along((4.6, 3.8), (4.6, 0.2))]
        {
            let responses: Vec<_> =
                walk.iter().map(|(x, z)| source.impulse_response(&listener(*x, *z, 40.0))).collect();
            for (pair, place) in responses.windows(2).zip(&walk) {
                let step_db = (energy_db(&pair[1]) - energy_db(&pair[0])).abs();
                assert!(step_db <= 3.0, "{step_db} dB within 5 cm at {place:?} from {from}");
                let turn_us = (lag_us(&pair[1], 100.0, 1000.0) - lag_us(&pair[0], 100.0, 1000.0)).abs();
                // Next to the jamb a small step is a large angle.
                assert!(
                    turn_us <= 120.0 || (place.0 - 4.1).abs() < 0.5,
                    "{turn_us} us within 5 cm at {place:?} from {from}"
                );
            }
        }
    }
}

/// Positions 5 cm apart on a straight line.
fn along(from: (f32, f32), to: (f32, f32)) -> Vec<(f32, f32)> {
    let steps = ((to.0 - from.0).hypot(to.1 - from.1) / 0.05) as usize;
    let share = |step: usize| step as f32 / steps as f32;
    (0..=steps).map(|s| (from.0 + (to.0 - from.0) * share(s), from.1 + (to.1 - from.1) * share(s))).collect()
}

#[test]
fn closed_doors_leave_only_wall_transmission() {
    let open = two_rooms(true).source(&source_beside_the_door());
    let closed = two_rooms(false).source(&source_beside_the_door());
    let place = listener(6.0, 3.0, 0.0);
    assert_eq!(closed.distance_m(&place.position), None);
    let (open, closed) = (open.impulse_response(&place), closed.impulse_response(&place));
    assert!(energy_db(&closed) < energy_db(&open) - 10.0);
    assert!(level_db(&closed.left, 125.0) > level_db(&closed.left, 2000.0) + 10.0);
    let opaque = opaque_rooms(false, Settings { ray_count: 500, ..Settings::default() });
    let nothing = opaque.source(&source_beside_the_door()).impulse_response(&place);
    assert!(nothing.left.iter().chain(&nothing.right).all(|tap| *tap == 0.0), "silence is exact");
}

#[test]
fn sources_inside_furniture_stay_audible() {
    let table = |height_m: f32| {
        let floor_and_ceiling = [[[-4.0, -0.2, -4.0], [4.0, 0.0, 4.0]], [[-4.0, 2.6, -4.0], [4.0, 2.8, 4.0]]];
        [&floor_and_ceiling[..], &[[[-0.5, 0.0, -0.5], [0.5, height_m, 0.5]]]].concat()
    };
    let open = building(&table(0.01)).source(&point(0.0, 0.4, 0.0));
    let shut_in = building(&table(0.8)).source(&point(0.0, 0.4, 0.0));
    for place in [listener(2.0, 0.0, 0.0), listener(-1.5, 2.0, 100.0)] {
        let loss_db =
            energy_db(&open.impulse_response(&place)) - energy_db(&shut_in.impulse_response(&place));
        assert!(loss_db.abs() < 16.0, "{loss_db} dB lost inside a box");
    }
}

#[test]
fn unusual_positions_give_finite_responses() {
    let house = two_rooms(true);
    let places = [
        point(2.0, 1.0, 2.0),
        point(4.1, 1.0, 3.0),
        point(4.0, 1.0, 1.0),
        point(-30.0, 5.0, 80.0),
        point(2.0, -0.1, 2.0),
        point(0.0, 0.0, 0.0),
        point(1e9, 0.0, 0.0),
        point(f32::NAN, 1.0, f32::INFINITY),
    ];
    for from in places {
        let source = house.source(&from);
        for position in places {
            for heading_rad in [0.0, 1e6, f32::NAN] {
                let response = source.impulse_response(&Listener { position, heading_rad });
                assert!(
                    response.left.iter().chain(&response.right).all(|tap| tap.is_finite()),
                    "{from} {position}"
                );
            }
        }
    }
}

#[test]
fn query_order_does_not_change_sources() {
    let places = [point(1.0, 1.0, 1.0), point(6.0, 0.5, 3.0), source_beside_the_door()];
    let ask = |order: [usize; 3]| {
        let house = two_rooms(true);
        order.iter().for_each(|index| house.source(&places[*index]).prepare());
        places.map(|place| house.source(&place).impulse_response(&listener(5.0, 1.0, 20.0)))
    };
    assert_eq!(ask([0, 1, 2]), ask([2, 0, 1]));
}
