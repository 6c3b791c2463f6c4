"""Measurement: sensors, noise, prior, and the square root of information."""
