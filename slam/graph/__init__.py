"""Pose graphs: their factors, and the solvers that optimise them."""
