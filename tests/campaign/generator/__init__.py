"""Random valid studies, and random drives for each."""
