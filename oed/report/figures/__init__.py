"""Figures: each draws plain data on the axes it is given."""
