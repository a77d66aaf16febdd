"""A world that changes: what learners make of it."""
