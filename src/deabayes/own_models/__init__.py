"""A user's own systems: finding their files, checking their classes, trying them on records."""
