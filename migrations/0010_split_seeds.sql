-- A secret split's seed is published with the other values of a phase.
ALTER TABLE phase_secrets ADD COLUMN seed TEXT; -- secret and recipe of the split, JSON; null before it is published
