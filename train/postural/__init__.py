"""Experiment 1: postural imitation."""
