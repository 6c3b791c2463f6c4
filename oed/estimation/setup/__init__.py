"""What an estimation is given: options, unknowns, noise."""
