"""Mobile robots: models, limits, sensors, usual drives and robots on sale."""
