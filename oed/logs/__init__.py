"""Logs of real drives: read from files, checked, and brought onto one clock."""
