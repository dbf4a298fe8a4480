-- Columns without a reader are dropped: `metrics` holds the same numbers. Methods get a description. A view joins a run with
-- the rows that complete it.

-- Episodes once more, without the metrics beside the JSON. Copying once is cheaper than dropping column by column, which
-- rewrites the table each time. Rows that refer to an episode wait for the end of the transaction.
PRAGMA defer_foreign_keys = ON;
CREATE TABLE episodes_kept AS
SELECT run, ordinal, episode, scene, state, attempts, interruptions, handle, end_reason, metrics, time_account, started_ms, finished_ms
FROM episodes;
DROP TABLE episodes;
-- The episodes of a run: waiting, running or over.
CREATE TABLE episodes (
  run           TEXT    NOT NULL REFERENCES runs (id),          -- the run
  ordinal       INTEGER NOT NULL CHECK (ordinal >= 0),          -- position in the run, from 0
  episode       TEXT    NOT NULL,                               -- id of the episode inside the split
  scene         TEXT    NOT NULL REFERENCES scenes (name),      -- its scene
  state         TEXT    NOT NULL CHECK (state IN ('pending', 'running', 'terminated', 'truncated', 'infra')), -- EpisodeState
  attempts      INTEGER NOT NULL DEFAULT 0,                     -- number of assignments
  interruptions INTEGER NOT NULL DEFAULT 0,                     -- attempts lost by the server
  handle        TEXT    UNIQUE,                                 -- agent-visible name; null before the first attempt
  end_reason    TEXT,                                           -- EndReason; null before the end
  metrics       TEXT,                                           -- JSON of Metrics; null before the end
  time_account  TEXT,                                           -- JSON of TimeAccount, seconds
  started_ms    INTEGER,                                        -- time of the last assignment
  finished_ms   INTEGER,                                        -- time of the result
  PRIMARY KEY (run, ordinal)
) STRICT;
INSERT INTO episodes SELECT * FROM episodes_kept;
DROP TABLE episodes_kept;
CREATE INDEX episodes_by_state ON episodes (run, state, ordinal);

ALTER TABLE run_summaries DROP COLUMN goals;
ALTER TABLE run_summaries DROP COLUMN found;
ALTER TABLE run_summaries DROP COLUMN sr;
ALTER TABLE run_summaries DROP COLUMN osr;
ALTER TABLE run_summaries DROP COLUMN spl;
ALTER TABLE run_summaries DROP COLUMN soft_spl;
ALTER TABLE run_summaries DROP COLUMN steps;
ALTER TABLE phases DROP COLUMN rules_name;
ALTER TABLE tokens DROP COLUMN prefix;

ALTER TABLE runs ADD COLUMN method_description TEXT;     -- text of the team about the method; null for none, like the columns below
ALTER TABLE runs ADD COLUMN method_code_url TEXT;        -- address of the code
ALTER TABLE runs ADD COLUMN method_paper_url TEXT;       -- address of the paper
ALTER TABLE runs ADD COLUMN method_weights_licence TEXT; -- licence of the weights
ALTER TABLE runs ADD COLUMN method_external_data TEXT;   -- training data other than the benchmark's

-- Runs with their progress, ruling and deadline. A migration that rebuilds one of the tables must drop this view first.
CREATE VIEW run_overview AS
SELECT r.*, s.scored + s.given_up AS done, COALESCE(g.verified, 0) AS verified, g.disqualified,
  -- A run without wall time ends with its phase: at once if the organiser closed it by hand.
  COALESCE(r.deadline_ms, CASE p.state WHEN 'closed' THEN r.created_ms ELSE p.closes_ms END) AS ends_ms
FROM runs r JOIN run_summaries s ON s.run = r.id JOIN phases p ON p.id = r.phase LEFT JOIN rulings g ON g.run = r.id;
