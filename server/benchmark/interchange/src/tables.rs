//! Export of a split as Parquet tables.

use crate::{
    InterchangeError,
    authors_export::{ExportedFile, SceneMissions},
};
use avln_dataset::{CueSpec, CueView, EpisodeSpec, GoalSpec, PublicGoal, PublicMission, ReferenceTour};
use avln_episode::Modality;
use avln_geom::{Point3, Pose};
use avln_truth::Target;
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
use std::{collections::BTreeMap, sync::Arc};

/// Tables for a split: missions and goals; with ground truth also targets, places and tours. A scene is a row group.
pub struct Tables {
    split: String,
    files: BTreeMap<&'static str, ParquetFile>,
}

impl Tables {
    /// Returns empty tables for a split.
    pub fn new(split: &str) -> Self {
        Self { split: split.to_owned(), files: BTreeMap::new() }
    }

    /// Adds missions in a scene.
    pub fn add(&mut self, scene: &str, missions: &SceneMissions) -> Result<(), InterchangeError> {
        match missions {
            SceneMissions::Public(missions) => {
                self.append("missions", scene_missions(scene, missions))?;
                self.append("goals", goals(missions))
            }
            SceneMissions::Whole(episodes) => self.add_whole(scene, episodes),
        }
    }

    /// Returns the files.
    pub fn finish(self) -> Result<Vec<ExportedFile>, InterchangeError> {
        let split = self.split;
        let file = |(name, table): (&str, ParquetFile)| {
            Ok(ExportedFile { path: format!("{split}/{name}.parquet"), bytes: table.finish()? })
        };
        self.files.into_iter().map(file).collect()
    }

    fn add_whole(&mut self, scene: &str, episodes: &[EpisodeSpec]) -> Result<(), InterchangeError> {
        let public: Vec<PublicMission> = episodes.iter().map(EpisodeSpec::public).collect();
        let mut missions = scene_missions(scene, &public);
        missions.extend(lengths(episodes));
        self.append("missions", missions)?;
        let mut goals = goals(&public);
        goals.extend(goal_truth(episodes));
        self.append("goals", goals)?;
        let known = episodes.iter().flat_map(|episode| &episode.goals);
        let targets: BTreeMap<u32, &Target> =
            known.map(|goal| (goal.target.instance, &goal.target)).collect();
        let targets: Vec<&Target> = targets.into_values().collect();
        self.append("targets", self::targets(scene, &targets))?;
        self.append("places", places(scene, &targets))?;
        self.append("tours", tours(episodes))
    }

    fn append(&mut self, table: &'static str, columns: Vec<Column>) -> Result<(), InterchangeError> {
        self.files.entry(table).or_insert_with(|| ParquetFile::new(table)).append(&columns)
    }
}

fn column<T>(name: &'static str, kind: fn(Vec<T>) -> Values, values: impl Iterator<Item = T>) -> Column {
    let values: Vec<T> = values.collect();
    Column { name, rows: values.len(), values: kind(values) }
}

fn text<'a>(name: &'static str, values: impl Iterator<Item = &'a str>) -> Column {
    column(name, Values::Text, values.map(str::to_owned))
}

fn whole(name: &'static str, values: impl Iterator<Item = usize>) -> Column {
    column(name, Values::Whole, values.map(|value| i32::try_from(value).unwrap_or(i32::MAX)))
}

fn single(name: &'static str, values: impl Iterator<Item = f32>) -> Column {
    column(name, Values::Single, values)
}

fn double(name: &'static str, values: impl Iterator<Item = f64>) -> Column {
    column(name, Values::Double, values)
}

fn place(names: [&'static str; 3], places: &[Point3<f32>]) -> [Column; 3] {
    let along = |axis: usize| single(names[axis], places.iter().map(move |place| place[axis]));
    [0, 1, 2].map(along)
}

fn scene_missions(scene: &str, missions: &[PublicMission]) -> Vec<Column> {
    let starts: Vec<Point3<f32>> = missions.iter().map(|mission| mission.start.position).collect();
    let mut columns = vec![
        text("mission", missions.iter().map(|mission| mission.id.as_str())),
        text("scene", missions.iter().map(|_| scene)),
        whole("goals", missions.iter().map(|mission| mission.goals.len())),
        single("start_heading_rad", missions.iter().map(|mission| mission.start.heading_rad)),
    ];
    columns.extend(place(["start_x_m", "start_y_m", "start_z_m"], &starts));
    columns
}

fn goals(missions: &[PublicMission]) -> Vec<Column> {
    let numbered = |mission: &PublicMission| (0..mission.goals.len()).collect::<Vec<_>>();
    let all = || missions.iter().flat_map(|mission| &mission.goals);
    let ids = missions.iter().flat_map(|mission| mission.goals.iter().map(|_| mission.id.as_str()));
    vec![
        text("mission", ids),
        whole("goal", missions.iter().flat_map(numbered)),
        text("modality", all().map(|goal| modality(goal).as_str())),
        text("text", all().map(words)),
    ]
}

fn modality(goal: &PublicGoal) -> Modality {
    match goal {
        PublicGoal::Category(_) => Modality::Category,
        PublicGoal::Description(_) => Modality::Description,
        PublicGoal::Image => Modality::Image,
    }
}

fn words(goal: &PublicGoal) -> &str {
    match goal {
        PublicGoal::Category(words) | PublicGoal::Description(words) => words,
        PublicGoal::Image => "",
    }
}

fn lengths(episodes: &[EpisodeSpec]) -> [Column; 4] {
    let tours = |tour: fn(&EpisodeSpec) -> &ReferenceTour| episodes.iter().map(tour);
    [
        double("ordered_m", tours(|episode| &episode.ordered).map(|tour| tour.length_m)),
        whole("ordered_steps", tours(|episode| &episode.ordered).map(|tour| tour.steps as usize)),
        double("unordered_m", tours(|episode| &episode.unordered).map(|tour| tour.length_m)),
        whole("unordered_steps", tours(|episode| &episode.unordered).map(|tour| tour.steps as usize)),
    ]
}

/// Hidden goal columns. Goals without a picture have a NaN camera.
fn goal_truth(episodes: &[EpisodeSpec]) -> Vec<Column> {
    let all = || episodes.iter().flat_map(|episode| &episode.goals);
    let pose = Pose { position: Point3::new(f32::NAN, f32::NAN, f32::NAN), heading_rad: f32::NAN };
    let no_view = CueView { pose, hfov_rad: f32::NAN, side_px: 0 };
    let view = |goal: &GoalSpec| match goal.cue {
        CueSpec::Image(view) => view,
        CueSpec::Category | CueSpec::Description(_) => no_view,
    };
    let cameras: Vec<Point3<f32>> = all().map(|goal| view(goal).pose.position).collect();
    let mut columns = vec![
        whole("instance", all().map(|goal| goal.target.instance as usize)),
        double("start_distance_m", all().map(|goal| goal.target.start_distance_m)),
        whole("distractors", all().map(|goal| usize::from(goal.distractors))),
        single("view_heading_rad", all().map(|goal| view(goal).pose.heading_rad)),
        single("view_hfov_rad", all().map(|goal| view(goal).hfov_rad)),
    ];
    columns.extend(place(["view_x_m", "view_y_m", "view_z_m"], &cameras));
    columns
}

fn targets(scene: &str, targets: &[&Target]) -> Vec<Column> {
    let places =
        |of: fn(&Target) -> Point3<f32>| -> Vec<_> { targets.iter().map(|target| of(target)).collect() };
    let mut columns = vec![
        text("scene", targets.iter().map(|_| scene)),
        whole("instance", targets.iter().map(|target| target.instance as usize)),
        text("category", targets.iter().map(|target| target.category.as_str())),
        single("floor_y_m", targets.iter().map(|target| target.floor_y_m)),
    ];
    columns.extend(place(["box_min_x_m", "box_min_y_m", "box_min_z_m"], &places(|target| target.bounds.min)));
    columns.extend(place(["box_max_x_m", "box_max_y_m", "box_max_z_m"], &places(|target| target.bounds.max)));
    columns.extend(place(["source_x_m", "source_y_m", "source_z_m"], &places(|target| target.source)));
    columns
}

/// Success region points, with NaN as heading, and viewpoints.
fn places(scene: &str, targets: &[&Target]) -> Vec<Column> {
    let row = |target: &&Target| {
        let instance = target.instance as usize;
        let region = target.region.iter().map(move |place| (instance, "region", *place, f32::NAN));
        let seen = target.viewpoints.iter();
        let seen = seen.map(move |pose| (instance, "viewpoint", pose.position, pose.heading_rad));
        region.chain(seen).collect::<Vec<_>>()
    };
    let rows: Vec<_> = targets.iter().flat_map(row).collect();
    let at: Vec<Point3<f32>> = rows.iter().map(|row| row.2).collect();
    let mut columns = vec![
        text("scene", rows.iter().map(|_| scene)),
        whole("instance", rows.iter().map(|row| row.0)),
        text("kind", rows.iter().map(|row| row.1)),
        single("heading_rad", rows.iter().map(|row| row.3)),
    ];
    columns.extend(place(["x_m", "y_m", "z_m"], &at));
    columns
}

fn tours(episodes: &[EpisodeSpec]) -> Vec<Column> {
    let corners = |episode: &EpisodeSpec| {
        let id = episode.id.clone();
        let both = [("ordered", &episode.ordered), ("unordered", &episode.unordered)];
        let of = |(order, tour): (&'static str, &ReferenceTour)| {
            let corners = tour.path.iter().enumerate();
            corners.map(|(corner, point)| (id.clone(), order, corner, *point)).collect::<Vec<_>>()
        };
        both.map(of).concat()
    };
    let rows: Vec<_> = episodes.iter().flat_map(corners).collect();
    let at: Vec<Point3<f32>> = rows.iter().map(|row| row.3).collect();
    let mut columns = vec![
        text("mission", rows.iter().map(|row| row.0.as_str())),
        text("order", rows.iter().map(|row| row.1)),
        whole("corner", rows.iter().map(|row| row.2)),
    ];
    columns.extend(place(["x_m", "y_m", "z_m"], &at));
    columns
}

/// A named column without missing values.
struct Column {
    name: &'static str,
    rows: usize,
    values: Values,
}

enum Values {
    Text(Vec<String>),
    Whole(Vec<i32>),
    Single(Vec<f32>),
    Double(Vec<f64>),
}

/// A file under construction, compressed by gzip, with a row group per [`append`](Self::append).
struct ParquetFile {
    name: String,
    writer: Option<SerializedFileWriter<Vec<u8>>>,
}

impl ParquetFile {
    fn new(name: &str) -> Self {
        Self { name: name.to_owned(), writer: None }
    }

    /// Appends rows. Names and types of the columns must agree between calls, and their lengths within a call.
    fn append(&mut self, columns: &[Column]) -> Result<(), InterchangeError> {
        self.try_append(columns).map_err(|error| InterchangeError::unwritable(&self.name, &error))
    }

    fn try_append(&mut self, columns: &[Column]) -> Result<(), ParquetError> {
        if self.writer.is_none() {
            self.writer = Some(writer(columns)?);
        }
        // A table without rows still has a schema.
        let has_rows = columns.first().is_some_and(|column| column.rows > 0);
        if let Some(writer) = self.writer.as_mut().filter(|_| has_rows) {
            let mut group = writer.next_row_group()?;
            columns.iter().try_for_each(|column| write(&mut group, &column.values))?;
            group.close()?;
        }
        Ok(())
    }

    fn finish(self) -> Result<Vec<u8>, InterchangeError> {
        match self.writer {
            Some(writer) => {
                writer.into_inner().map_err(|error| InterchangeError::unwritable(&self.name, &error))
            }
            None => Ok(Vec::new()),
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use std::path::Path;

    fn columns(texts: &[&str]) -> [Column; 4] {
        let half = |text: &&str| if text.is_empty() { f32::NAN } else { text.len() as f32 / 2.0 };
        [
            text("name", texts.iter().copied()),
            whole("length", texts.iter().map(|text| text.len())),
            single("half", texts.iter().map(half)),
            double("tenth", texts.iter().map(|text| text.len() as f64 / 10.0)),
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
        // Written before the crate `parquet` was used: a page per column, without statistics.
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
