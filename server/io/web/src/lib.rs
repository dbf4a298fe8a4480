//! The people's door: pages, REST API, plots.
