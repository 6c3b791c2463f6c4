"""How fast the package is: `make bench` runs every benchmark and writes the table in docs/benchmarks.md.

A benchmark is a module of this folder with a function `figures()`; it is listed in `BENCHMARKS`.
`python -m benchmarks.acceptance DIR` says whether a saved trial on slipping robots meets the project's goals.
"""
