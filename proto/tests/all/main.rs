//! Protocol tests: page, messages and encodings.

mod codec;
mod messages;
mod page;
