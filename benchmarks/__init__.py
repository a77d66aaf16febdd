"""Measurements that decided how things are built; each module prints its own table."""
