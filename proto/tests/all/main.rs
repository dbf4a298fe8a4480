//! Tests of the protocol: its page, its messages and its encodings.

mod codec;
mod messages;
mod page;
