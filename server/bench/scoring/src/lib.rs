//! Pure: (truth, record) to metrics; aggregates, intervals, ranks.
