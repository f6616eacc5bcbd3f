"""The library: poses, scans, matching, mapping, pose graph. Imports no other package of the project."""
