"""Runs and sweeps side by side: methods × scenarios, distributions, worst cases."""
