-- Rulings on runs.

-- What the organiser ruled on a run after looking at it. Its scores stay as they are.
CREATE TABLE rulings (
  run          TEXT    NOT NULL PRIMARY KEY REFERENCES runs (id), -- the run
  verified     INTEGER NOT NULL CHECK (verified IN (0, 1)),     -- whether the organiser verified it
  disqualified TEXT,                                            -- why it is on no board, for everybody to read; null where it may be
  ruled_ms     INTEGER NOT NULL                                 -- when the organiser ruled last
) STRICT, WITHOUT ROWID;
