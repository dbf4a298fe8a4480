-- Phases by file and date, quotas by cause, members, scopes of tokens, samples and their secrets, and an audit list.
-- Columns that hold settings are JSON of the Rust type of the same name.

ALTER TABLE phases ADD COLUMN description TEXT NOT NULL DEFAULT '';   -- text for people
ALTER TABLE phases ADD COLUMN position INTEGER NOT NULL DEFAULT 0;    -- place in the organiser's file, from 0
ALTER TABLE phases ADD COLUMN opens_ms INTEGER;                       -- when runs may start; null for at once
ALTER TABLE phases ADD COLUMN closes_ms INTEGER;                      -- from when no run may start; null for never
ALTER TABLE phases ADD COLUMN paused TEXT;                            -- why no run may start for now; null while they may
ALTER TABLE phases ADD COLUMN quotas TEXT NOT NULL DEFAULT '{}';      -- JSON of QuotaLimits
ALTER TABLE phases ADD COLUMN time TEXT NOT NULL DEFAULT '{}';        -- JSON of TimeLimits
ALTER TABLE phases ADD COLUMN ranking TEXT NOT NULL DEFAULT '{}';     -- JSON of Ranking
ALTER TABLE phases ADD COLUMN admission TEXT NOT NULL DEFAULT '{}';   -- JSON of Admission
ALTER TABLE phases ADD COLUMN sampling TEXT NOT NULL DEFAULT '{}';    -- JSON of Sampling
UPDATE phases SET quotas = json_object('total', quota) WHERE quota IS NOT NULL;
ALTER TABLE phases DROP COLUMN quota;

-- What keys a phase's samples and orders, and what was promised of it.
CREATE TABLE phase_secrets (
  phase        TEXT    NOT NULL PRIMARY KEY REFERENCES phases (id), -- the phase
  secret       TEXT    NOT NULL,                                -- 256 random bits, hex
  pool         TEXT    NOT NULL,                                -- digest of the phase's episodes
  scorer       TEXT    NOT NULL,                                -- version of the benchmark when it was made
  commitment   TEXT    NOT NULL,                                -- BLAKE3 of pool, scorer and secret
  committed_ms INTEGER NOT NULL,                                -- when it was made
  revealed_ms  INTEGER                                          -- when the organiser published the secret; null before
) STRICT;

-- Who is in a team, phase by phase.
CREATE TABLE members (
  phase    TEXT    NOT NULL REFERENCES phases (id),             -- the phase
  person   TEXT    NOT NULL,                                    -- the person, as an address of e-mail is written
  team     TEXT    NOT NULL REFERENCES teams (name),            -- the one team of the person in the phase
  added_ms INTEGER NOT NULL,                                    -- when the person was entered
  PRIMARY KEY (phase, person)
) STRICT, WITHOUT ROWID;

-- Teams that may play in phases that ask for approval.
CREATE TABLE approvals (
  phase       TEXT    NOT NULL REFERENCES phases (id),          -- the phase
  team        TEXT    NOT NULL REFERENCES teams (name),         -- the team
  approved_ms INTEGER NOT NULL,                                 -- when it was approved
  PRIMARY KEY (phase, team)
) STRICT, WITHOUT ROWID;

-- Runs that the organiser gave to a team beyond its quota.
CREATE TABLE grants (
  id         INTEGER NOT NULL PRIMARY KEY,                      -- counts up
  phase      TEXT    NOT NULL REFERENCES phases (id),           -- where they can be used
  team       TEXT    NOT NULL REFERENCES teams (name),          -- whose they are
  runs       INTEGER NOT NULL CHECK (runs > 0),                 -- how many
  reason     TEXT    NOT NULL,                                  -- why
  granted_ms INTEGER NOT NULL                                   -- when
) STRICT;

-- What was changed, by whom and why. Rows are added and nothing else.
CREATE TABLE audit (
  id      INTEGER NOT NULL PRIMARY KEY,                         -- counts up
  at_ms   INTEGER NOT NULL,                                     -- when
  actor   TEXT    NOT NULL,                                     -- who
  subject TEXT    NOT NULL,                                     -- of what: phase practice, team red
  what    TEXT    NOT NULL,                                     -- the setting or the deed
  before  TEXT,                                                 -- what it was; null for nothing
  after   TEXT,                                                 -- what it is; null for nothing
  reason  TEXT    NOT NULL                                      -- why; may be empty
) STRICT;
CREATE TRIGGER audit_is_never_changed BEFORE UPDATE ON audit BEGIN SELECT RAISE(ABORT, 'the audit list is append-only'); END;
CREATE TRIGGER audit_is_never_cut BEFORE DELETE ON audit BEGIN SELECT RAISE(ABORT, 'the audit list is append-only'); END;

-- Tokens once more, with names and with read-only ones.
CREATE TEMP TABLE tokens_kept AS SELECT * FROM tokens;
DROP TABLE tokens;
-- Secrets that open doors. The secret itself is never stored.
CREATE TABLE tokens (
  hash       TEXT    NOT NULL PRIMARY KEY,                      -- BLAKE3 of the secret, hex
  prefix     TEXT    NOT NULL,                                  -- first letters of the secret
  kind       TEXT    NOT NULL CHECK (kind IN ('account', 'read_only', 'organiser', 'run')), -- which door it opens
  name       TEXT    NOT NULL DEFAULT '',                       -- what its maker called it
  team       TEXT    REFERENCES teams (name),                   -- whose it is; null for an organiser's
  run        TEXT    REFERENCES runs (id),                      -- the run it plays; null unless kind is run
  created_ms INTEGER NOT NULL,                                  -- when it was issued
  expires_ms INTEGER,                                           -- from when it is void; null for never
  revoked_ms INTEGER,                                           -- when it was taken back; null while it holds
  CHECK ((kind = 'run') = (run IS NOT NULL) AND (kind = 'organiser') = (team IS NULL))
) STRICT;
INSERT INTO tokens (hash, prefix, kind, team, run, created_ms, expires_ms, revoked_ms)
SELECT hash, prefix, kind, team, run, created_ms, expires_ms, revoked_ms FROM tokens_kept;
DROP TABLE tokens_kept;

-- Runs once more, with two more ways to end. Rows that point at them wait for the end of the transaction.
PRAGMA defer_foreign_keys = ON;
CREATE TEMP TABLE runs_kept AS SELECT * FROM runs;
DROP TABLE runs;
-- One pass of one method over all episodes of a phase, or a sample of them.
CREATE TABLE runs (
  id                TEXT    NOT NULL PRIMARY KEY,               -- run_ and random letters
  phase             TEXT    NOT NULL REFERENCES phases (id),    -- what is played
  team              TEXT    NOT NULL REFERENCES teams (name),   -- who plays
  method            TEXT    NOT NULL,                           -- name of the method, as the team gave it
  version           TEXT    NOT NULL,                           -- version of the method, as the team gave it
  mission_order     TEXT    NOT NULL CHECK (mission_order IN ('ordered', 'unordered')), -- how goals count
  state             TEXT    NOT NULL CHECK (state IN ('created', 'running', 'completed', 'cancelled', 'failed', 'expired')), -- how far it is
  episodes          INTEGER NOT NULL CHECK (episodes >= 0),     -- episodes in all
  client_request_id TEXT,                                       -- the client's own id of its request; null for none
  sensors           TEXT,                                       -- JSON of Sensors that the agent asked for; null before
  digests           TEXT    NOT NULL,                           -- JSON object: what was in force, by name
  created_ms        INTEGER NOT NULL,                           -- when it was started
  finished_ms       INTEGER,                                    -- when it ended; null before
  UNIQUE (team, client_request_id)
) STRICT;
INSERT INTO runs (id, phase, team, method, version, mission_order, state, episodes, client_request_id, sensors, digests, created_ms, finished_ms)
SELECT id, phase, team, method, version, mission_order, state, episodes, client_request_id, sensors, digests, created_ms, finished_ms FROM runs_kept;
DROP TABLE runs_kept;
CREATE INDEX runs_by_phase ON runs (phase, mission_order, state);
CREATE INDEX runs_by_team ON runs (team, phase);
