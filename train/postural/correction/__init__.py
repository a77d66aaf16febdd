"""Corrections where a situation is new."""
