"""The journal of a recording: crash-safe storage of its episodes until they are folded."""
