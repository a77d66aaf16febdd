"""The journal of a recording, and how it becomes part of a dataset."""
