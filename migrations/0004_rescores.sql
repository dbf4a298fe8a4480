-- Runs that were scored again by another scorer. What they were worth at first stays in `episodes` and `run_summaries`.

-- A run by another scorer. Rows are added and nothing else.
CREATE TABLE rescores (
  run       TEXT    NOT NULL REFERENCES runs (id),              -- the run
  scorer    TEXT    NOT NULL,                                   -- version of the benchmark that scored it
  scored_ms INTEGER NOT NULL,                                   -- when
  summary   TEXT,                                               -- JSON of Summary; null when no episode counts
  PRIMARY KEY (run, scorer)
) STRICT, WITHOUT ROWID;

-- Its episodes that count.
CREATE TABLE rescored_episodes (
  run     TEXT    NOT NULL,                                     -- the run
  scorer  TEXT    NOT NULL,                                     -- version of the benchmark that scored it
  ordinal INTEGER NOT NULL,                                     -- the episode's place
  metrics TEXT    NOT NULL,                                     -- JSON of Metrics
  PRIMARY KEY (run, scorer, ordinal),
  FOREIGN KEY (run, scorer) REFERENCES rescores (run, scorer)
) STRICT, WITHOUT ROWID;

CREATE TRIGGER rescores_are_never_changed BEFORE UPDATE ON rescores BEGIN SELECT RAISE(ABORT, 'scores are added and never changed'); END;
CREATE TRIGGER rescored_episodes_are_never_changed BEFORE UPDATE ON rescored_episodes BEGIN SELECT RAISE(ABORT, 'scores are added and never changed'); END;
