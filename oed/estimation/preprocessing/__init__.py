"""Logs before they are fitted: clocks, wiring, long logs thinned."""
