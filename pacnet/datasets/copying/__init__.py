"""A copy of a dataset in format v3.0: what it takes from the source, and how it is written."""
