"""The files of a LeRobot dataset, as they lie on disk."""
