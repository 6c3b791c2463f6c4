"""The command line: parse, call a command, map errors to exit codes."""

from oed.cli.program import main as main
