//! UTC dates for timestamps in milliseconds since 1970-01-01 UTC.

use jiff::{Timestamp, civil::Date, tz::Offset};

const DAY_S: u32 = 86_400;

/// Converts a UTC date and a second after midnight to a timestamp; `None` if there is no such date or second.
pub fn unix_ms(year: u16, month: u8, day: u8, second_of_day: u32) -> Option<i64> {
    let date =
        Date::new(i16::try_from(year).ok()?, i8::try_from(month).ok()?, i8::try_from(day).ok()?).ok()?;
    let midnight = midnight(date)?;
    (second_of_day < DAY_S).then(|| midnight + 1000 * i64::from(second_of_day))
}

/// Formats a timestamp by RFC 3339 in whole seconds: `2026-07-01T00:00:00Z`.
pub fn rfc3339(unix_ms: i64) -> String {
    let second = Timestamp::from_second(unix_ms.div_euclid(1000));
    second.unwrap_or(if unix_ms < 0 { Timestamp::MIN } else { Timestamp::MAX }).to_string()
}

/// Returns the enclosing UTC day: start and end.
pub fn day_around(unix_ms: i64) -> (i64, i64) {
    let day_ms = 1000 * i64::from(DAY_S);
    let start = unix_ms.div_euclid(day_ms) * day_ms;
    (start, start + day_ms)
}

/// Returns the enclosing UTC month: start and end.
pub fn month_around(unix_ms: i64) -> (i64, i64) {
    let moment = Timestamp::from_millisecond(unix_ms).unwrap_or_default();
    let date = Offset::UTC.to_datetime(moment).date();
    let next = date.last_of_month().tomorrow().ok();
    (midnight(date.first_of_month()).unwrap_or(0), next.and_then(midnight).unwrap_or(i64::MAX))
}

fn midnight(date: Date) -> Option<i64> {
    let midnight = Offset::UTC.to_timestamp(date.at(0, 0, 0, 0)).ok()?;
    Some(midnight.as_millisecond())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DAY_MS: i64 = 86_400_000;

    #[test]
    fn known_timestamps_are_formatted_and_parsed() {
        // From `date -u -d @SECONDS`.
        let known = [
            (0, "1970-01-01T00:00:00Z"),
            (951_827_696, "2000-02-29T12:34:56Z"),
            (1_772_323_199, "2026-02-28T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
            (-86_400, "1969-12-31T00:00:00Z"),
        ];
        for (seconds, text) in known {
            assert_eq!(rfc3339(seconds * 1000), text);
            assert_eq!(rfc3339(seconds * 1000 + 999), text);
        }
        assert_eq!(unix_ms(2000, 2, 29, 45_296), Some(951_827_696_000));
        assert_eq!(
            [unix_ms(2026, 2, 29, 0), unix_ms(2026, 13, 1, 0), unix_ms(2026, 1, 1, 86_400)],
            [None; 3]
        );
    }

    proptest! {
        #[test]
        fn dates_parse_back(days in -1000_i64..146_097) {
            let text = rfc3339(days * DAY_MS);
            let part = |range: std::ops::Range<usize>| text[range].parse::<u16>().expect("digits");
            let parsed = unix_ms(part(0..4), part(5..7) as u8, part(8..10) as u8, 0);
            prop_assert_eq!(parsed, Some(days * DAY_MS));
        }

        #[test]
        fn windows_contain_their_timestamp(moment in 0_i64..4_102_444_800_000) {
            for (start, end) in [day_around(moment), month_around(moment)] {
                prop_assert!((start..end).contains(&moment));
                prop_assert_eq!(rfc3339(start).split_once('T').map(|(_, time)| time.to_owned()), Some("00:00:00Z".to_owned()));
            }
        }
    }

    #[test]
    fn december_is_followed_by_january() {
        let december = unix_ms(2026, 12, 1, 0).expect("a date");
        let january = unix_ms(2027, 1, 1, 0).expect("a date");
        for moment in [december, january - 1] {
            assert_eq!(month_around(moment), (december, january));
        }
        assert_eq!(month_around(january).0, january);
        assert_eq!(day_around(december + 5), (december, december + DAY_MS));
        assert_eq!(day_around(december - 1), (december - DAY_MS, december));
    }
}
