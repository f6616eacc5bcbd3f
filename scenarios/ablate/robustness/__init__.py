"""What each corruption of a recording does to the answers of the methods."""
