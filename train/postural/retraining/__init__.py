"""Retraining by spoiled demonstrations."""
