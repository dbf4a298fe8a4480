//! SQLite rows to domain types and back; blobs; visibility applied on read.
