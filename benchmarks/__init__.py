"""How fast the package is: `make bench` runs every benchmark and writes the table in README.md.

A benchmark is a module of this folder with a function `figures()`; it is listed in `BENCHMARKS`.
"""
