"""From scans to a track: matching scan by scan, dead reckoning, and measures of where it failed."""
