"""`python -m oed`: the command line."""

from oed.cli import main

raise SystemExit(main())
