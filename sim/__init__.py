"""A world that makes a robot lose its place: floor plans, terrain, a tilted laser, an INS and a driver."""
