"""Metrics, principal components and figures, from plain arrays."""
