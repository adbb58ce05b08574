"""What a user asks for, held against what there is before anything is run."""
