"""Damaged files: what is damaged, how, and what the command line may make of it."""
