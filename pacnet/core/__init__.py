"""Growable buffers, checks, checkpoints and durable files, which all other folders use."""
