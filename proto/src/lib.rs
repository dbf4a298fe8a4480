//! The words that agents and server exchange.
