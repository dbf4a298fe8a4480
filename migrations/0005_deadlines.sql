-- When runs end at the latest, and when the server was there, so that its absence costs nobody time.

ALTER TABLE runs ADD COLUMN deadline_ms INTEGER; -- when the run's wall time is over; null where it has none

-- One row: the server that hosts this database.
CREATE TABLE uptime (
  id           INTEGER NOT NULL PRIMARY KEY CHECK (id = 1),     -- there is one row
  alive_ms     INTEGER NOT NULL,                                -- when the server last said that it is there
  drain_ms     INTEGER,                                         -- when it began to stop for maintenance; null where it did not
  drain_reason TEXT                                             -- why; null with drain_ms
) STRICT;

-- Open runs of phases with a wall time were told of it when they began.
UPDATE runs SET deadline_ms = created_ms + 1000 * (SELECT json_extract(p.time, '$.run_s') FROM phases p WHERE p.id = runs.phase)
WHERE state IN ('created', 'running') AND (SELECT json_extract(p.time, '$.run_s') FROM phases p WHERE p.id = runs.phase) > 0;
