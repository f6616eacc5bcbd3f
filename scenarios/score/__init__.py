"""Scoring what others answered: their trajectories and maps, on any recording, as our own methods are."""
