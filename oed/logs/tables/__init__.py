"""Logs as text tables: CSV and TUM."""
