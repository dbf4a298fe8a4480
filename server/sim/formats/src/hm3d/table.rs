//! The table `X.semantic.txt`.

use crate::files::Checked;
use avln_scene::InstanceId;
use avln_scene::limits::MAX_WORD_CHARS;
use std::collections::BTreeSet;

/// First line.
pub(super) const HEADER: &str = "HM3D Semantic Annotations";

/// A table line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct InstanceAnnotation {
    /// Instance number, at least 1.
    pub(super) id: u32,
    /// Painted colour.
    pub(super) color: [u8; 3],
    /// The annotator's words.
    pub(super) category: String,
    /// Room number in the file; negative for none.
    pub(super) region: i32,
}

/// Parses the table: a header line, then lines `id,HEXRGB,"category",region`. Number 0 is unknown and left out.
pub(super) fn parse(text: &str) -> Checked<Vec<InstanceAnnotation>> {
    let mut lines = text.lines().enumerate();
    let header = lines.next().map(|(_, line)| line).unwrap_or_default();
    if !header.contains(HEADER) {
        return Err(format!("its first line is not {HEADER:?}; use the .semantic.txt of HM3D"));
    }
    let mut annotations = Vec::new();
    let mut seen = BTreeSet::new();
    for (index, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let annotation = annotation(line.trim()).ok_or_else(|| {
            let start: String = line.chars().take(MAX_WORD_CHARS).collect();
            format!(
                "line {} is {start:?}, not: number up to 16777215, hex colour, quoted category, region",
                index + 1
            )
        })?;
        if !seen.insert(annotation.id) {
            return Err(format!(
                "line {} repeats number {}; renumber the instances",
                index + 1,
                annotation.id
            ));
        }
        annotations.push(annotation);
    }
    annotations.retain(|annotation| annotation.id != 0);
    Ok(annotations)
}

fn annotation(line: &str) -> Option<InstanceAnnotation> {
    let (id, rest) = line.split_once(',')?;
    let (hex, rest) = rest.split_once(',')?;
    let (category, region) = rest.rsplit_once(',')?;
    Some(InstanceAnnotation {
        id: id.trim().parse().ok().filter(|&id| id <= InstanceId::MAX)?,
        color: color(hex.trim())?,
        category: category
            .trim()
            .trim_matches('"')
            .trim()
            .chars()
            .filter(|letter| !letter.is_control())
            .take(MAX_WORD_CHARS)
            .collect(),
        region: region.trim().parse().ok()?,
    })
}

fn color(hex: &str) -> Option<[u8; 3]> {
    let digits = hex.strip_prefix('#').unwrap_or(hex);
    if digits.len() != 6 {
        return None;
    }
    let [_, r, g, b] = u32::from_str_radix(digits, 16).ok()?.to_be_bytes();
    Some([r, g, b])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn categories_may_contain_commas() {
        let text =
            "HM3D Semantic Annotations\r\n0,000000,\"Unknown\",-1\r\n7,1A2B3C,\"table, small\",4\r\n\r\n";
        let expected = InstanceAnnotation {
            id: 7,
            color: [0x1a, 0x2b, 0x3c],
            category: "table, small".to_owned(),
            region: 4,
        };
        assert_eq!(parse(text).unwrap(), [expected]);
    }

    #[test]
    fn invalid_lines_are_named() {
        for bad in ["7,12,\"x\",0", "16777216,123456,\"x\",0", "7,123456,\"x\"", "7,123456,\"x\",one", "x"] {
            let error = parse(&format!("{HEADER}\n1,AABBCC,\"bed\",0\n{bad}\n")).unwrap_err();
            assert!(error.starts_with("line 3"), "{error}");
        }
        assert!(parse("1,AABBCC,\"bed\",0").unwrap_err().contains("first line"));
        let twice = format!("{HEADER}\n1,AABBCC,\"bed\",0\n1,AABBCD,\"sofa\",0");
        assert!(parse(&twice).unwrap_err().contains("repeats number"));
    }
}
