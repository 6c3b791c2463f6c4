"""A campaign against the package: random problems, damaged files and faults, each judged independently.

Every case follows from one seed. `python -m tests.campaign --help` says how to run it.
"""
