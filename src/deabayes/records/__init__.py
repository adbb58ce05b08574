"""Study folders, records in many formats, and the preparation of records."""
