-- Phases that only sealed runs may be played in.

ALTER TABLE phases ADD COLUMN sealed INTEGER NOT NULL DEFAULT 0 CHECK (sealed IN (0, 1)); -- whether runs must be sealed
