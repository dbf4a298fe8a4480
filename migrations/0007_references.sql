-- Teams whose runs are shown among the others for comparison and have no rank.

ALTER TABLE teams ADD COLUMN reference TEXT CHECK (reference IN ('baseline', 'oracle', 'human')); -- what the team's runs are a reference for; null where it competes

UPDATE teams SET reference = 'baseline' WHERE baseline = 1;
ALTER TABLE teams DROP COLUMN baseline;
