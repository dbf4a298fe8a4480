//! Days and months in UTC, out of milliseconds since 1970-01-01 UTC and back.

const DAY_MS: i64 = 86_400_000;

/// A date of the proleptic Gregorian calendar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Date {
    year: i64,
    /// 1 to 12.
    month: i64,
    /// 1 to 31.
    day: i64,
}

/// Days from 1970-01-01 to a date. The formula counts days from 1 March, so that the leap day comes last
/// (H. Hinnant, "chrono-Compatible Low-Level Date Algorithms").
fn days_of(date: Date) -> i64 {
    let year = date.year - i64::from(date.month <= 2);
    let era = year.div_euclid(400);
    let year_of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((date.month + 9) % 12) + 2) / 5 + date.day - 1;
    era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468
}

/// The date that lies `days` after 1970-01-01; the reverse of [`days_of`].
fn date_of(days: i64) -> Date {
    let days = days + 719_468;
    let era = days.div_euclid(146_097);
    let day_of_era = days.rem_euclid(146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let month = (shifted_month + 2) % 12 + 1;
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    Date { year, month, day: day_of_year - (153 * shifted_month + 2) / 5 + 1 }
}

/// The moment of a date and a time of day in UTC; `None` when there is no such date or time.
pub fn unix_ms(year: u16, month: u8, day: u8, seconds_of_day: u32) -> Option<i64> {
    let date = Date { year: i64::from(year), month: i64::from(month), day: i64::from(day) };
    let days = days_of(date);
    let exists =
        (1..=12).contains(&month) && date_of(days) == date && i64::from(seconds_of_day) * 1000 < DAY_MS;
    exists.then(|| days * DAY_MS + i64::from(seconds_of_day) * 1000)
}

/// A moment as RFC 3339 writes it, to the second: `2026-07-01T00:00:00Z`.
pub fn rfc3339(unix_ms: i64) -> String {
    let Date { year, month, day } = date_of(unix_ms.div_euclid(DAY_MS));
    let seconds = unix_ms.rem_euclid(DAY_MS) / 1000;
    let (hour, minute, second) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// When the UTC day of a moment began, and when the next one begins.
pub(crate) fn day_around(unix_ms: i64) -> (i64, i64) {
    let start = unix_ms.div_euclid(DAY_MS) * DAY_MS;
    (start, start + DAY_MS)
}

/// When the UTC month of a moment began, and when the next one begins.
pub(crate) fn month_around(unix_ms: i64) -> (i64, i64) {
    let Date { year, month, .. } = date_of(unix_ms.div_euclid(DAY_MS));
    let (next_year, next_month) = if month == 12 { (year + 1, 1) } else { (year, month + 1) };
    let first = |year, month| days_of(Date { year, month, day: 1 }) * DAY_MS;
    (first(year, month), first(next_year, next_month))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_moments_are_written_and_read() {
        // From `date -u -d @SECONDS`.
        let known = [
            (0, "1970-01-01T00:00:00Z"),
            (951_827_696, "2000-02-29T12:34:56Z"),
            (1_772_323_199, "2026-02-28T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
            (-86_400, "1969-12-31T00:00:00Z"),
        ];
        for (seconds, words) in known {
            assert_eq!(rfc3339(seconds * 1000), words);
        }
        assert_eq!(unix_ms(2000, 2, 29, 45_296), Some(951_827_696_000));
        assert_eq!(
            [unix_ms(2026, 2, 29, 0), unix_ms(2026, 13, 1, 0), unix_ms(2026, 1, 1, 86_400)],
            [None; 3]
        );
    }

    #[test]
    fn every_day_of_four_centuries_comes_back() {
        for days in -1000..146_097 {
            assert_eq!(days_of(date_of(days)), days);
        }
    }

    #[test]
    fn windows_hold_their_moment_and_touch() {
        let second = |words: &str| (0..).map(|day| day * DAY_MS).find(|&ms| rfc3339(ms) == words);
        let december = second("2026-12-01T00:00:00Z").unwrap_or_default();
        let january = second("2027-01-01T00:00:00Z").unwrap_or_default();
        for moment in [december, january - 1] {
            assert_eq!(month_around(moment), (december, january));
        }
        assert_eq!(month_around(january).0, january);
        assert_eq!(day_around(december + 5), (december, december + DAY_MS));
        assert_eq!(day_around(december - 1), (december - DAY_MS, december));
    }
}
