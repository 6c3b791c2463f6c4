"""From readings to information: sensors, noise, prior, and the square root of information."""
