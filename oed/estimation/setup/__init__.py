"""What an estimation is told: options, unknowns, noise."""
