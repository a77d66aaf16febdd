"""Experiment 1 alone: the glass is there, and nobody shows what to do with it."""
