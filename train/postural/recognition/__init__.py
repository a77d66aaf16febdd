"""Recognition of behaviours."""
