"""Modules that are loaded beside other work."""

import subprocess
import sys
import threading

from oed.cli.design_commands import LATER
from oed.foundation.work.ahead import load_ahead


def test_they_are_loaded_and_what_is_missing_says_nothing(capfd):
    module = "xml.dom.expatbuilder"
    sys.modules.pop(module, None)
    before = set(threading.enumerate())
    load_ahead("oed.no_such_module", module)
    for thread in set(threading.enumerate()) - before:
        thread.join()
    assert module in sys.modules
    assert capfd.readouterr() == ("", "")


def test_a_run_needs_what_it_loads_ahead():
    # Of the modules' own names one mistyped would be found by nothing else.
    code = "from importlib import import_module\n" + "\n".join(f"import_module({one!r})" for one in LATER)
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
