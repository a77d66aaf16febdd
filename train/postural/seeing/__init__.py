"""Experiment 1 seen: where the glass is stands in the picture of a camera beside the head alone."""
