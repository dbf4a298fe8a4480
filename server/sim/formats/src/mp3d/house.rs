//! A house's table (`.house`, Matterport3D's data organisation, version "ASCII 1.1"): one record a line.

use crate::files::{Checked, refuse_if};
use std::{collections::BTreeMap, str::FromStr};

const HEADER: &str = "ASCII 1.1";
/// Coordinate limit; boxes for rooms without surfaces exceed it.
const EMPTY_BOX: f32 = 1.0e6;

/// Levels, rooms and objects in the table; lengths in metres, Z up.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct HouseTable {
    pub(super) levels: Vec<HouseLevel>,
    pub(super) regions: Vec<HouseRoom>,
    pub(super) categories: BTreeMap<u32, Category>,
    pub(super) objects: Vec<HouseObject>,
    /// Object number by segment id.
    pub(super) object_of_segment: BTreeMap<i64, u32>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct HouseLevel {
    pub(super) index: u32,
    pub(super) floor_m: f32,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct HouseRoom {
    pub(super) index: u32,
    pub(super) level: Option<u32>,
    pub(super) label: String,
    /// Two corners; `None` for a room without surfaces.
    pub(super) bounds: Option<[[f32; 3]; 2]>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Category {
    pub(super) raw_name: String,
    pub(super) mpcat40_index: Option<u32>,
    pub(super) mpcat40_name: String,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct HouseObject {
    pub(super) index: u32,
    pub(super) region: Option<u32>,
    pub(super) category: Option<u32>,
}

#[derive(Default)]
struct RecordCounts {
    objects: usize,
    categories: usize,
    regions: usize,
    levels: usize,
}

/// Parses the table; errors name the line.
pub(super) fn parse(text: &str) -> Checked<HouseTable> {
    let mut lines = text.lines().enumerate();
    let first = lines.next().map(|(_, line)| line.trim()).unwrap_or_default();
    if first != HEADER {
        let start: String = first.chars().take(40).collect();
        return Err(format!("line 1 is {start:?}, not {HEADER:?}; use the .house file of Matterport3D"));
    }
    let mut house = HouseTable::default();
    let mut announced = None;
    for (index, line) in lines {
        let record = Record { words: line.split_whitespace().collect() };
        let fail = |reason: String| format!("line {}: {reason}; copy the file again", index + 1);
        match record.words.first().copied().unwrap_or_default() {
            "H" => announced = Some(record.announced().map_err(fail)?),
            _ => house.add(&record).map_err(fail)?,
        }
    }
    house.check(&announced.ok_or("it has no header record H; copy the file again")?)?;
    Ok(house)
}

impl HouseTable {
    fn add(&mut self, record: &Record<'_>) -> Checked<()> {
        match record.words.first().copied().unwrap_or_default() {
            "L" => self.levels.push(record.level()?),
            "R" => self.regions.push(record.room()?),
            "O" => self.objects.push(record.object()?),
            "C" => {
                let (index, category) = record.category()?;
                refuse_if(self.categories.insert(index, category).is_some(), || {
                    format!("category {index} is not unique")
                })?;
            }
            "E" => {
                if let Some((segment, object)) = record.segment()? {
                    self.object_of_segment.insert(segment, object);
                }
            }
            "P" | "S" | "V" | "I" | "" => {}
            other => {
                let start: String = other.chars().take(20).collect();
                return Err(format!("{start:?} is no record type (H, L, R, P, S, V, I, C, O, E)"));
            }
        }
        Ok(())
    }

    /// Checks that numbers are unique, and that no record is missing.
    fn check(&self, announced: &RecordCounts) -> Checked<()> {
        let mut numbers = [
            ("level", self.levels.iter().map(|level| level.index).collect::<Vec<u32>>()),
            ("region", self.regions.iter().map(|room| room.index).collect()),
            ("object", self.objects.iter().map(|object| object.index).collect()),
        ];
        for (what, numbers) in &mut numbers {
            numbers.sort_unstable();
            if let Some(twice) = numbers.windows(2).find(|pair| pair[0] == pair[1]) {
                return Err(format!("{what} number {} is not unique; renumber them", twice[0]));
            }
        }
        for (what, found, announced) in [
            ("levels", self.levels.len(), announced.levels),
            ("regions", self.regions.len(), announced.regions),
            ("categories", self.categories.len(), announced.categories),
            ("objects", self.objects.len(), announced.objects),
        ] {
            refuse_if(found < announced, || {
                format!(
                    "it has {found} {what}, its header announces {announced}; it is incomplete, copy it again"
                )
            })?;
        }
        Ok(())
    }
}

struct Record<'a> {
    words: Vec<&'a str>,
}

impl Record<'_> {
    fn word<T: FromStr>(&self, at: usize, what: &str) -> Checked<T> {
        let word = self.words.get(at).ok_or_else(|| format!("the record ends before its {what}"))?;
        word.parse().map_err(|_| {
            let start: String = word.chars().take(20).collect();
            format!("{start:?} is no {what}")
        })
    }

    /// A number that is -1 for none.
    fn optional(&self, at: usize, what: &str) -> Checked<Option<u32>> {
        let number: i64 = self.word(at, what)?;
        if number == -1 {
            return Ok(None);
        }
        u32::try_from(number).map(Some).map_err(|_| format!("{number} is no {what}"))
    }

    fn number_m(&self, at: usize, what: &str) -> Checked<f32> {
        let number: f32 = self.word(at, what)?;
        if number.is_finite() { Ok(number) } else { Err(format!("{number} is no {what}")) }
    }

    /// Parses the box with six numbers from `at` on; `None` for an inverted box, the mark of a room without surfaces.
    fn bounds(&self, at: usize) -> Checked<Option<[[f32; 3]; 2]>> {
        let mut numbers = [0.0; 6];
        for (offset, number) in numbers.iter_mut().enumerate() {
            *number = self.number_m(at + offset, "corner of its box")?;
        }
        let [x0, y0, z0, x1, y1, z1] = numbers;
        if numbers.iter().any(|number| number.abs() > EMPTY_BOX) {
            return Ok(None);
        }
        refuse_if(x0 > x1 || y0 > y1 || z0 > z1, || {
            format!("its box has a negative size, {} x {} x {} m", x1 - x0, y1 - y0, z1 - z0)
        })?;
        Ok(Some([[x0, y0, z0], [x1, y1, z1]]))
    }

    fn announced(&self) -> Checked<RecordCounts> {
        // H name label #images #panoramas #vertices #surfaces #segments #objects #categories #regions #portals #levels
        Ok(RecordCounts {
            objects: self.word(8, "number of objects")?,
            categories: self.word(9, "number of categories")?,
            regions: self.word(10, "number of regions")?,
            levels: self.word(12, "number of levels")?,
        })
    }

    fn level(&self) -> Checked<HouseLevel> {
        // L level_index #regions label px py pz box
        let floor_m = self.bounds(7)?.map_or(0.0, |[low, _]| low[2]);
        Ok(HouseLevel { index: self.word(1, "number of a level")?, floor_m })
    }

    fn room(&self) -> Checked<HouseRoom> {
        // R region_index level_index 0 0 label px py pz box height
        Ok(HouseRoom {
            index: self.word(1, "number of a region")?,
            level: self.optional(2, "number of a level")?,
            label: self.word(5, "label")?,
            bounds: self.bounds(9)?,
        })
    }

    fn category(&self) -> Checked<(u32, Category)> {
        // C category_index category_mapping_index category_mapping_name mpcat40_index mpcat40_name
        let name: String = self.word(3, "name of a category")?;
        let category = Category {
            raw_name: name.replace('#', " "),
            mpcat40_index: self.optional(4, "number of an mpcat40 category")?,
            mpcat40_name: self.word(5, "name of an mpcat40 category")?,
        };
        Ok((self.word(1, "number of a category")?, category))
    }

    fn object(&self) -> Checked<HouseObject> {
        // O object_index region_index category_index px py pz a0x a0y a0z a1x a1y a1z r0 r1 r2
        for at in 13..16 {
            let radius_m = self.number_m(at, "radius of its box")?;
            refuse_if(radius_m < 0.0, || format!("its box has the negative radius {radius_m} m"))?;
        }
        Ok(HouseObject {
            index: self.word(1, "number of an object")?,
            region: self.optional(2, "number of a region")?,
            category: self.optional(3, "number of a category")?,
        })
    }

    fn segment(&self) -> Checked<Option<(i64, u32)>> {
        // E segment_index object_index id
        let object = self.optional(2, "number of an object")?;
        let id = self.word(3, "id of a segment")?;
        Ok(object.map(|object| (id, object)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "ASCII 1.1\n\
        H made - 0 0 0 0 1 2 1 1 0 1 0 0 0 0 0 0 0 0 4 5 6 0 0 0 0 0\n\
        L 0 1 - 2 2 1 0 0 -0.5 4 5 6 0 0 0 0 0\n\
        R 3 0 0 0 k 2 2 1 0 0 0 4 5 2.5 2.5 0 0 0 0\n\
        P name 0 3 0 1 1 1 0 0 0 0 0\n\
        C 0 12 office#desk 5 table 0 0 0 0 0\n\
        O 0 3 0 1 1 1 1 0 0 0 1 0 0.5 0.5 0.5 0 0 0 0 0 0 0 0\n\
        O 1 -1 -1 1 1 1 1 0 0 0 1 0 0.5 0.5 0.5 0 0 0 0 0 0 0 0\n\
        E 0 1 3000007 1.5 0 0 0 0 0 0 1 1 1 0 0 0 0 0\n";

    #[test]
    fn records_are_read() {
        let house = parse(TEXT).unwrap();
        assert_eq!(house.levels, [HouseLevel { index: 0, floor_m: -0.5 }]);
        let room = HouseRoom {
            index: 3,
            level: Some(0),
            label: "k".into(),
            bounds: Some([[0.0; 3], [4.0, 5.0, 2.5]]),
        };
        assert_eq!(house.regions, [room]);
        assert_eq!(house.categories[&0].raw_name, "office desk");
        assert_eq!(house.objects[0], HouseObject { index: 0, region: Some(3), category: Some(0) });
        assert_eq!(house.objects[1], HouseObject { index: 1, region: None, category: None });
        assert_eq!(house.object_of_segment[&3_000_007], 1);
    }

    #[test]
    fn a_room_without_surfaces_has_no_box() {
        let text = TEXT.replace("0 0 0 4 5 2.5 2.5", "3e38 3e38 3e38 -3e38 -3e38 -3e38 0");
        assert_eq!(parse(&text).unwrap().regions[0].bounds, None);
    }

    #[test]
    fn errors_name_the_line() {
        for (from, to, expected) in [
            ("ASCII 1.1", "ASCII 1.0", "line 1"),
            ("R 3 0", "R three 0", "line 4: \"three\""),
            ("R 3 0", "R", "line 4"),
            ("0 0 0 4 5 2.5", "0 0 0 4 -5 2.5", "line 4: its box has a negative size"),
            ("0.5 0.5 0.5 0", "0.5 -0.5 0.5 0", "line 7: its box has the negative radius"),
            ("0.5 0.5 0.5 0", "0.5 nan 0.5 0", "line 7"),
            ("O 1 -1", "O 0 -1", "object number 0 is not unique"),
            ("O 1 -1 -1", "P 1 -1 -1", "it has 1 objects, its header announces 2"),
            ("E 0 1 3000007", "E 0 1", "line 9"),
            ("P name", "Q name", "line 5: \"Q\""),
            ("H made", "P made", "no header record"),
        ] {
            let error = parse(&TEXT.replacen(from, to, 1)).unwrap_err();
            assert!(error.contains(expected), "{to}: {error}");
        }
        let cut = &TEXT[..TEXT.find("\nO 0").unwrap()];
        assert!(parse(cut).unwrap_err().contains("is incomplete"));
    }
}
