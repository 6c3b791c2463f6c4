"""A search's program: unknowns, objective, grid and starts."""
