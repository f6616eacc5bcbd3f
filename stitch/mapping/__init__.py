"""A recording becomes a map: track, cut, stitch, close the loops, adjust."""
