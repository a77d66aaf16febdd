"""Experiment 2: imitation by following walls."""
