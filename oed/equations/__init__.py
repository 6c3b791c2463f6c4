"""Systems that are given by equations: what their expressions mean, and the units in them."""
