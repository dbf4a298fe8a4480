/// Why a file of another data set could not be read.
#[derive(Debug, thiserror::Error)]
pub enum FormatsError {
    /// Something in it is not what it should be.
    #[error("{file}, at {place}: {cause}")]
    Malformed {
        /// The file.
        file: String,
        /// Where in the file.
        place: String,
        /// What is wrong there.
        cause: String,
    },
    /// It is of no known format.
    #[error(
        "{file} is of no format that is known: it has the keys {keys}; name one of {known} if it is one of them"
    )]
    Unknown {
        /// The file.
        file: String,
        /// Its keys.
        keys: String,
        /// Names of the formats.
        known: String,
    },
    /// A file could not be written.
    #[error("{file} cannot be written: {cause}")]
    Unwritable {
        /// The file.
        file: String,
        /// What is wrong.
        cause: String,
    },
}
