"""A user's own systems: load their files, check their classes and try them on records."""
