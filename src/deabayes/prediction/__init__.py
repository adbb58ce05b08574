"""What a fitted candidate predicts, with bands; where it extrapolates; how far off it is."""
