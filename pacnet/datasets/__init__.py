"""The files of LeRobot datasets and the journal of a recording, for reader and `Recorder`."""
