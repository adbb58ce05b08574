"""Reading what a user brings: study folders, records in many formats, public data."""
