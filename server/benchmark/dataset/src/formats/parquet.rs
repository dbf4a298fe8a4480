//! Parquet files of plain columns: no nesting, no missing values, pages packed by gzip.
//!
//! What is written is a small part of the format (<https://parquet.apache.org/docs/file-format/>), so that no library is
//! needed; the same values give the same bytes.

mod thrift;

use super::{FormatsError, pack::pack};
use thrift::Struct;

/// What a file begins and ends with.
const MAGIC: &[u8; 4] = b"PAR1";
/// Numbers that the format gives to what is written here.
const REQUIRED: i32 = 0;
const UTF8: i32 = 0;
const PLAIN: i32 = 0;
const RLE: i32 = 3;
const GZIP: i32 = 2;
const DATA_PAGE: i32 = 0;

/// A column of a table: its name and its values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    pub(super) name: &'static str,
    pub(super) values: Values,
}

/// Values of one kind.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    Text(Vec<String>),
    Whole(Vec<i32>),
    Single(Vec<f32>),
    Double(Vec<f64>),
}

/// A file that grows by groups of rows.
pub(super) struct Parquet {
    name: String,
    bytes: Vec<u8>,
    schema: Vec<Vec<u8>>,
    groups: Vec<Vec<u8>>,
    rows: i64,
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Whole(values) => values.len(),
            Self::Single(values) => values.len(),
            Self::Double(values) => values.len(),
        }
    }

    /// The format's number of their type.
    fn kind(&self) -> i32 {
        match self {
            Self::Whole(_) => 1,
            Self::Single(_) => 4,
            Self::Double(_) => 5,
            Self::Text(_) => 6,
        }
    }

    /// Their bytes in the encoding PLAIN.
    fn plain(&self) -> Vec<u8> {
        match self {
            Self::Text(values) => values.iter().flat_map(|text| counted(text)).collect(),
            Self::Whole(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::Single(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::Double(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        }
    }
}

/// A text behind the number of its bytes.
fn counted(text: &str) -> Vec<u8> {
    let mut bytes = (text.len() as u32).to_le_bytes().to_vec();
    bytes.extend(text.as_bytes());
    bytes
}

impl Parquet {
    /// An empty file, called `name` in messages.
    pub(super) fn new(name: &str) -> Self {
        Self { name: name.to_owned(), bytes: MAGIC.to_vec(), schema: Vec::new(), groups: Vec::new(), rows: 0 }
    }

    /// Appends rows. Names and kinds of the columns are the same each time, and so are the numbers of their values.
    pub(super) fn append(&mut self, columns: &[Column]) -> Result<(), FormatsError> {
        let rows = columns.first().map_or(0, |column| column.values.len());
        if self.schema.is_empty() {
            self.schema = columns.iter().map(element).collect();
        }
        if rows == 0 {
            return Ok(());
        }
        let (mut chunks, mut total) = (Vec::new(), 0);
        for column in columns {
            let (chunk, bytes) = self.chunk(column)?;
            chunks.push(chunk);
            total += bytes;
        }
        self.groups.push(Struct::new().structs(1, &chunks).i64(2, total).i64(3, rows as i64).end());
        self.rows += rows as i64;
        Ok(())
    }

    /// Writes the page of a column; gives back what the footer says of it, and its bytes before they were packed.
    fn chunk(&mut self, column: &Column) -> Result<(Vec<u8>, i64), FormatsError> {
        let plain = column.values.plain();
        let packed = pack(&plain).map_err(|error| self.unwritable(error.to_string()))?;
        let [plain_bytes, packed_bytes, values] =
            [plain.len(), packed.len(), column.values.len()].map(i32::try_from);
        let too_large = |_| self.unwritable(format!("a column `{}` of a scene is too large", column.name));
        let (plain_bytes, packed_bytes) = (plain_bytes.map_err(too_large)?, packed_bytes.map_err(too_large)?);
        let values = values.map_err(too_large)?;
        let page = Struct::new().i32(1, values).i32(2, PLAIN).i32(3, RLE).i32(4, RLE).end();
        let header = Struct::new().i32(1, DATA_PAGE).i32(2, plain_bytes).i32(3, packed_bytes);
        let header = header.inner(5, &page).end();
        let offset = self.bytes.len() as i64;
        let head_bytes = header.len() as i64;
        self.bytes.extend(header);
        self.bytes.extend(packed);
        let (plain_bytes, packed_bytes) =
            (i64::from(plain_bytes) + head_bytes, i64::from(packed_bytes) + head_bytes);
        let facts = Struct::new()
            .i32(1, column.values.kind())
            .i32s(2, &[PLAIN, RLE])
            .texts(3, &[column.name])
            .i32(4, GZIP)
            .i64(5, i64::from(values))
            .i64(6, plain_bytes)
            .i64(7, packed_bytes)
            .i64(9, offset);
        Ok((Struct::new().i64(2, offset).inner(3, &facts.end()).end(), plain_bytes))
    }

    /// The whole file.
    pub(super) fn finish(mut self) -> Vec<u8> {
        let root = Struct::new().text(4, "schema").i32(5, self.schema.len() as i32).end();
        let schema: Vec<Vec<u8>> = [root].into_iter().chain(self.schema).collect();
        let footer = Struct::new()
            .i32(1, 1)
            .structs(2, &schema)
            .i64(3, self.rows)
            .structs(4, &self.groups)
            .text(6, "avln")
            .end();
        let length = footer.len() as u32;
        self.bytes.extend(footer);
        self.bytes.extend(length.to_le_bytes());
        self.bytes.extend(MAGIC);
        self.bytes
    }

    fn unwritable(&self, cause: String) -> FormatsError {
        FormatsError::Unwritable { file: self.name.clone(), cause }
    }
}

/// What the schema says of a column.
fn element(column: &Column) -> Vec<u8> {
    let element = Struct::new().i32(1, column.values.kind()).i32(3, REQUIRED).text(4, column.name);
    match column.values {
        Values::Text(_) => element.i32(6, UTF8).end(),
        _ => element.end(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(names: &[&str]) -> [Column; 2] {
        let text = names.iter().map(|name| (*name).to_owned()).collect();
        let lengths = names.iter().map(|name| name.len() as i32).collect();
        [
            Column { name: "name", values: Values::Text(text) },
            Column { name: "length", values: Values::Whole(lengths) },
        ]
    }

    #[test]
    fn a_file_has_its_footer_where_readers_look_for_it() {
        let mut file = Parquet::new("a");
        file.append(&columns(&["one", "three"])).unwrap();
        file.append(&columns(&[])).unwrap();
        file.append(&columns(&["seven"])).unwrap();
        let bytes = file.finish();
        assert!(bytes.starts_with(MAGIC) && bytes.ends_with(MAGIC));
        let end = bytes.len() - 8;
        let length = u32::from_le_bytes(bytes[end..end + 4].try_into().unwrap()) as usize;
        let footer = &bytes[end - length..end];
        // Version 1, then a list of three elements of the schema; the first page stands behind the magic word.
        assert_eq!(footer[..3], [0x15, 0x02, 0x19]);
        assert_eq!(footer[3], 0x3c);
        assert!(footer.windows(6).any(|window| window == b"length"));
        assert_eq!(bytes[4..6], [0x15, 0x00]);
    }

    #[test]
    fn values_are_laid_out_one_behind_the_other() {
        assert_eq!(Values::Text(vec!["ab".into(), String::new()]).plain(), [2, 0, 0, 0, 97, 98, 0, 0, 0, 0]);
        assert_eq!(Values::Whole(vec![-2]).plain(), [254, 255, 255, 255]);
        assert_eq!(Values::Single(vec![1.0]).plain(), [0, 0, 128, 63]);
        assert_eq!(Values::Double(vec![1.0]).plain(), [0, 0, 0, 0, 0, 0, 240, 63]);
    }
}
