//! Parquet files of flat columns without missing values, compressed by gzip.

use crate::InterchangeError;
use parquet::{
    basic::{Compression, GzipLevel, LogicalType, Repetition, Type as PhysicalType},
    data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type},
    errors::ParquetError,
    file::{
        properties::WriterProperties,
        writer::{SerializedFileWriter, SerializedRowGroupWriter},
    },
    schema::types::Type,
};
use std::sync::Arc;

/// A named column with the values.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Column {
    pub(crate) name: &'static str,
    pub(crate) values: Values,
}

/// Values of a type.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    Text(Vec<String>),
    Whole(Vec<i32>),
    Single(Vec<f32>),
    Double(Vec<f64>),
}

/// A file under construction, with a row group per [`append`](Self::append).
pub(crate) struct ParquetFile {
    name: String,
    writer: Option<SerializedFileWriter<Vec<u8>>>,
}

impl ParquetFile {
    /// Returns an empty file, named `name` in errors.
    pub(crate) fn new(name: &str) -> Self {
        Self { name: name.to_owned(), writer: None }
    }

    /// Appends rows. Names, types and lengths of the columns must agree between calls.
    pub(crate) fn append(&mut self, columns: &[Column]) -> Result<(), InterchangeError> {
        let result = self.try_append(columns);
        result.map_err(|error| unwritable(&self.name, &error))
    }

    fn try_append(&mut self, columns: &[Column]) -> Result<(), ParquetError> {
        if self.writer.is_none() {
            self.writer = Some(writer(columns)?);
        }
        // A table without rows still has a schema.
        let has_rows = columns.first().is_some_and(|column| !column.values.is_empty());
        if let Some(writer) = self.writer.as_mut().filter(|_| has_rows) {
            let mut group = writer.next_row_group()?;
            columns.iter().try_for_each(|column| write(&mut group, &column.values))?;
            group.close()?;
        }
        Ok(())
    }

    /// Returns the bytes of the file.
    pub(crate) fn finish(self) -> Result<Vec<u8>, InterchangeError> {
        match self.writer {
            Some(writer) => writer.into_inner().map_err(|error| unwritable(&self.name, &error)),
            None => Ok(Vec::new()),
        }
    }
}

fn unwritable(name: &str, error: &ParquetError) -> InterchangeError {
    InterchangeError::Unwritable { file: name.to_owned(), cause: error.to_string() }
}

fn writer(columns: &[Column]) -> Result<SerializedFileWriter<Vec<u8>>, ParquetError> {
    let fields =
        columns.iter().map(|column| Ok(Arc::new(field(column)?))).collect::<Result<_, ParquetError>>()?;
    let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
    // The default creator names the version of the library: equal values must give equal bytes across updates.
    let properties = WriterProperties::builder()
        .set_created_by("avln".to_owned())
        .set_compression(Compression::GZIP(GzipLevel::default()))
        .build();
    SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))
}

fn field(column: &Column) -> Result<Type, ParquetError> {
    let (physical, logical) = match column.values {
        Values::Text(_) => (PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
        Values::Whole(_) => (PhysicalType::INT32, None),
        Values::Single(_) => (PhysicalType::FLOAT, None),
        Values::Double(_) => (PhysicalType::DOUBLE, None),
    };
    Type::primitive_type_builder(column.name, physical)
        .with_repetition(Repetition::REQUIRED)
        .with_logical_type(logical)
        .build()
}

fn write(group: &mut SerializedRowGroupWriter<'_, Vec<u8>>, values: &Values) -> Result<(), ParquetError> {
    match values {
        Values::Text(texts) => {
            let bytes: Vec<ByteArray> = texts.iter().map(|text| text.as_str().into()).collect();
            write_typed::<ByteArrayType>(group, &bytes)
        }
        Values::Whole(values) => write_typed::<Int32Type>(group, values),
        Values::Single(values) => write_typed::<FloatType>(group, values),
        Values::Double(values) => write_typed::<DoubleType>(group, values),
    }
}

fn write_typed<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, Vec<u8>>,
    values: &[T::T],
) -> Result<(), ParquetError> {
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(values, None, None)?;
        column.close()?;
    }
    Ok(())
}

impl Values {
    fn is_empty(&self) -> bool {
        match self {
            Self::Text(values) => values.is_empty(),
            Self::Whole(values) => values.is_empty(),
            Self::Single(values) => values.is_empty(),
            Self::Double(values) => values.is_empty(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use std::path::Path;

    fn columns(texts: &[&str]) -> [Column; 4] {
        let half = |text: &&str| if text.is_empty() { f32::NAN } else { text.len() as f32 / 2.0 };
        [
            Column {
                name: "name",
                values: Values::Text(texts.iter().map(|text| (*text).to_owned()).collect()),
            },
            Column {
                name: "length",
                values: Values::Whole(texts.iter().map(|text| text.len() as i32).collect()),
            },
            Column { name: "half", values: Values::Single(texts.iter().map(half).collect()) },
            Column {
                name: "tenth",
                values: Values::Double(texts.iter().map(|t| t.len() as f64 / 10.0).collect()),
            },
        ]
    }

    fn example() -> Vec<u8> {
        let mut file = ParquetFile::new("a");
        file.append(&columns(&["one", "three", "three", ""])).unwrap();
        file.append(&columns(&[])).unwrap();
        file.append(&columns(&["größer"])).unwrap();
        file.finish().unwrap()
    }

    fn rows(bytes: Vec<u8>) -> Vec<String> {
        let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
        reader.get_row_iter(None).unwrap().map(|row| row.unwrap().to_string()).collect()
    }

    fn golden(name: &str) -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
    }

    #[test]
    fn equal_values_give_the_golden_bytes() {
        let path = golden("example.parquet");
        if std::env::var_os("AVLN_BLESS").is_some() {
            std::fs::write(&path, example()).unwrap();
        }
        assert!(example() == std::fs::read(&path).unwrap(), "{} has other bytes", path.display());
    }

    #[test]
    fn files_of_the_former_writer_have_equal_rows() {
        // Written before the crate `parquet` was used: one page per column, without statistics.
        let old = rows(std::fs::read(golden("former-writer.parquet")).unwrap());
        assert_eq!(old.len(), 5);
        assert!(old[4].contains("größer"), "{old:?}");
        assert_eq!(rows(example()), old);
    }

    #[test]
    fn table_without_rows_has_a_schema() {
        let mut file = ParquetFile::new("a");
        file.append(&columns(&[])).unwrap();
        let reader = SerializedFileReader::new(bytes::Bytes::from(file.finish().unwrap())).unwrap();
        let schema = reader.metadata().file_metadata().schema_descr();
        assert_eq!((schema.num_columns(), reader.metadata().num_row_groups()), (4, 0));
    }
}
