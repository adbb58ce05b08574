"""What a user brings: study folders, records in many formats, and their preparation."""
