"""What everything stands on: growable buffers, checks, checkpoints, durable files."""
