"""The study of confidence measures: what finds lost steps, and what the map is worth when it cuts."""
