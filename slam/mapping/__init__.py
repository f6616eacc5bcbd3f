"""What scans at known poses make: keyframes, occupancy grids, submaps."""
