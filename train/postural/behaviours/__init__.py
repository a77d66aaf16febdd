"""Several behaviours in one network."""
