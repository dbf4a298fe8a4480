-- The first schema of an LH-AVLN Arena database.
-- Times are milliseconds since 1970-01-01 UTC (`_ms`). JSON columns hold what the named Rust type serialises to.
-- Words (states, orders, visibilities) are the ones that `as_str` of the Rust type gives.

-- Tells our databases from other SQLite files: the letters AVLN.
PRAGMA application_id = 0x41564C4E;

-- Who takes part.
CREATE TABLE teams (
  name       TEXT    NOT NULL PRIMARY KEY,                      -- public name
  baseline   INTEGER NOT NULL CHECK (baseline IN (0, 1)),       -- 1 for the organiser's own reference agents
  created_ms INTEGER NOT NULL                                   -- when the team was added
) STRICT;

-- Secrets that open doors. The secret itself is never stored.
CREATE TABLE tokens (
  hash       TEXT    NOT NULL PRIMARY KEY,                      -- BLAKE3 of the secret, hex
  prefix     TEXT    NOT NULL,                                  -- first letters of the secret, to tell tokens apart
  kind       TEXT    NOT NULL CHECK (kind IN ('account', 'organiser', 'run')), -- which door it opens
  team       TEXT    REFERENCES teams (name),                   -- whose it is; null for an organiser's
  run        TEXT    REFERENCES runs (id),                      -- the run it plays; null unless kind is run
  created_ms INTEGER NOT NULL,                                  -- when it was issued
  expires_ms INTEGER,                                           -- from when it is void; null for never
  revoked_ms INTEGER,                                           -- when it was taken back; null while it holds
  CHECK ((kind = 'run') = (run IS NOT NULL) AND (kind = 'organiser') = (team IS NULL))
) STRICT;

-- Sets of missions, made once and never changed.
CREATE TABLE splits (
  name     TEXT    NOT NULL PRIMARY KEY,                        -- name of the split
  digest   TEXT    NOT NULL,                                    -- hash of all of its episodes
  scenes   INTEGER NOT NULL CHECK (scenes >= 0),                -- scenes that occur in it
  episodes INTEGER NOT NULL CHECK (episodes >= 0)               -- episodes in it
) STRICT;

-- Buildings, as far as pages show them.
CREATE TABLE scenes (
  name   TEXT NOT NULL PRIMARY KEY,                             -- name of the scene
  digest TEXT NOT NULL,                                         -- hash of its content
  map    TEXT NOT NULL                                          -- JSON of SceneMap: bounds and walkable polygons, metres
) STRICT;

-- What can be played, under which rules, and who may see the results.
CREATE TABLE phases (
  id         TEXT    NOT NULL PRIMARY KEY,                      -- id in URLs and requests
  title      TEXT    NOT NULL,                                  -- heading on pages
  split      TEXT    NOT NULL REFERENCES splits (name),         -- the missions' split
  rules_name TEXT    NOT NULL,                                  -- name of the rule set
  rules      TEXT    NOT NULL,                                  -- JSON of Rules, with every option
  orders     TEXT    NOT NULL,                                  -- JSON list of the orders that a run may choose
  sensors    TEXT    NOT NULL,                                  -- JSON of Sensors: the most that an agent may ask for
  scores     TEXT    NOT NULL CHECK (scores IN ('public', 'team', 'organiser')),  -- who may see scores
  replays    TEXT    NOT NULL CHECK (replays IN ('public', 'team', 'organiser')), -- who may see paths, maps and targets
  max_slots  INTEGER NOT NULL CHECK (max_slots > 0),            -- episodes that a run may play side by side
  quota      INTEGER CHECK (quota >= 0),                        -- runs that a team may start; null for any number
  state      TEXT    NOT NULL CHECK (state IN ('open', 'closed')), -- whether runs may start
  created_ms INTEGER NOT NULL                                   -- when the phase was added
) STRICT;

-- The episodes of a phase in playing order.
CREATE TABLE phase_episodes (
  phase   TEXT    NOT NULL REFERENCES phases (id),              -- the phase
  ordinal INTEGER NOT NULL CHECK (ordinal >= 0),                -- place in the list, from 0
  episode TEXT    NOT NULL,                                     -- id of the episode inside the split
  scene   TEXT    NOT NULL REFERENCES scenes (name),            -- where it takes place
  goals   TEXT    NOT NULL,                                     -- JSON list of GoalText: how each goal is told, in words
  PRIMARY KEY (phase, ordinal),
  UNIQUE (phase, episode)
) STRICT, WITHOUT ROWID;

-- One pass of one method over all episodes of a phase.
CREATE TABLE runs (
  id                TEXT    NOT NULL PRIMARY KEY,               -- run_ and random letters
  phase             TEXT    NOT NULL REFERENCES phases (id),    -- what is played
  team              TEXT    NOT NULL REFERENCES teams (name),   -- who plays
  method            TEXT    NOT NULL,                           -- name of the method, as the team gave it
  version           TEXT    NOT NULL,                           -- version of the method, as the team gave it
  mission_order     TEXT    NOT NULL CHECK (mission_order IN ('ordered', 'unordered')), -- how goals count
  state             TEXT    NOT NULL CHECK (state IN ('created', 'running', 'completed', 'cancelled')), -- how far it is
  episodes          INTEGER NOT NULL CHECK (episodes >= 0),     -- episodes in all
  client_request_id TEXT,                                       -- the client's own id of its request; null for none
  sensors           TEXT,                                       -- JSON of Sensors that the agent asked for; null before
  digests           TEXT    NOT NULL,                           -- JSON object: what was in force, by name
  created_ms        INTEGER NOT NULL,                           -- when it was started
  finished_ms       INTEGER,                                    -- when it was completed or cancelled; null before
  UNIQUE (team, client_request_id)
) STRICT;
CREATE INDEX runs_by_phase ON runs (phase, mission_order, state);

-- The episodes of a run: waiting, being played, or done.
CREATE TABLE episodes (
  run           TEXT    NOT NULL REFERENCES runs (id),          -- the run
  ordinal       INTEGER NOT NULL CHECK (ordinal >= 0),          -- place in the phase's list, from 0
  episode       TEXT    NOT NULL,                               -- id of the episode inside the split
  scene         TEXT    NOT NULL REFERENCES scenes (name),      -- where it takes place
  state         TEXT    NOT NULL CHECK (state IN ('pending', 'running', 'terminated', 'truncated', 'infra')), -- how far it is
  attempts      INTEGER NOT NULL DEFAULT 0,                     -- times it was handed out
  interruptions INTEGER NOT NULL DEFAULT 0,                     -- attempts that the server itself lost
  handle        TEXT    UNIQUE,                                 -- random name that the agent sees; null before the first attempt
  end_reason    TEXT,                                           -- why it ended; null before
  goals         INTEGER,                                        -- goals of the mission; null before the end, like all below
  found         INTEGER,                                        -- goals found
  sr            REAL,                                           -- success, 0 or 1
  isr           REAL,                                           -- share of goals found
  osr           REAL,                                           -- share of goals whose region was entered
  osr_all       REAL,                                           -- whether all regions were entered, 0 or 1
  spl           REAL,                                           -- success weighted by path length
  soft_spl      REAL,                                           -- share of goals found weighted by path length
  sna           REAL,                                           -- success weighted by number of actions
  steps         INTEGER,                                        -- actions taken
  path_m        REAL,                                           -- length of the walk, metres
  reference_m   REAL,                                           -- length of the reference tour, metres
  collisions    INTEGER,                                        -- actions held back by an obstacle
  wrong_submits INTEGER,                                        -- claims that completed nothing
  metrics       TEXT,                                           -- JSON of Metrics, with the numbers of each goal
  time_account  TEXT,                                           -- JSON of TimeAccount, seconds
  started_ms    INTEGER,                                        -- when the last attempt was handed out
  finished_ms   INTEGER,                                        -- when the result was stored
  PRIMARY KEY (run, ordinal)
) STRICT;
CREATE INDEX episodes_by_state ON episodes (run, state, ordinal);

-- The hidden side of played episodes, each version of it once.
CREATE TABLE truths (
  digest TEXT NOT NULL PRIMARY KEY,                             -- BLAKE3 of the body, hex
  body   BLOB NOT NULL                                          -- JSON of EpisodeTruth
) STRICT;

-- The facts from which scores are computed.
CREATE TABLE records (
  run     TEXT    NOT NULL,                                     -- the run
  ordinal INTEGER NOT NULL,                                     -- the episode's place
  truth   TEXT    NOT NULL REFERENCES truths (digest),          -- what was true in it
  body    BLOB    NOT NULL,                                     -- the Record, packed as avln-store's module `packed` says
  PRIMARY KEY (run, ordinal),
  FOREIGN KEY (run, ordinal) REFERENCES episodes (run, ordinal)
) STRICT;

-- Sums over the scored episodes of a run, kept in step with them.
CREATE TABLE run_summaries (
  run               TEXT    NOT NULL PRIMARY KEY REFERENCES runs (id), -- the run
  scored            INTEGER NOT NULL DEFAULT 0,                 -- episodes that count
  given_up          INTEGER NOT NULL DEFAULT 0,                 -- episodes that the server lost for good; done, but do not count
  goals             INTEGER NOT NULL DEFAULT 0,                 -- their goals
  found             INTEGER NOT NULL DEFAULT 0,                 -- goals found
  sr                REAL    NOT NULL DEFAULT 0,                 -- sum of sr
  isr               REAL    NOT NULL DEFAULT 0,                 -- sum of isr
  osr               REAL    NOT NULL DEFAULT 0,                 -- sum of osr
  spl               REAL    NOT NULL DEFAULT 0,                 -- sum of spl
  soft_spl          REAL    NOT NULL DEFAULT 0,                 -- sum of soft_spl
  steps             INTEGER NOT NULL DEFAULT 0,                 -- sum of steps
  category_goals    INTEGER NOT NULL DEFAULT 0,                 -- goals told by category
  category_found    INTEGER NOT NULL DEFAULT 0,                 -- of these, found
  description_goals INTEGER NOT NULL DEFAULT 0,                 -- goals told by a sentence
  description_found INTEGER NOT NULL DEFAULT 0,                 -- of these, found
  image_goals       INTEGER NOT NULL DEFAULT 0,                 -- goals told by a picture
  image_found       INTEGER NOT NULL DEFAULT 0,                 -- of these, found
  server_faults     INTEGER NOT NULL DEFAULT 0,                 -- attempts that ended by the server's fault and do not count
  summary           TEXT                                        -- JSON of Summary, once the run is completed; null before
) STRICT;
