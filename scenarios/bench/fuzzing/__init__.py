"""Damaged files for every reader: what they are made from, what harms them, and what reading them does."""
