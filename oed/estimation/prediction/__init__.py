"""What readings are by what is unknown: segments, layouts, first guesses."""
