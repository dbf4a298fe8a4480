-- What a run sensed in any of its sessions; `sensors` is what the last one asked for.

ALTER TABLE runs ADD COLUMN senses TEXT; -- JSON of Sensors; null before the first session

UPDATE runs SET senses = sensors;
