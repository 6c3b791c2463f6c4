"""What a study produced, typed and saved."""
