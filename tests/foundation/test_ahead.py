"""Processes that load what they need before there are tasks for them."""

import subprocess
import sys
from importlib.util import find_spec

import pytest

from oed.cli.design_commands import LATER

CODE = """
import sys
from oed.foundation.work.parallel import load_ahead, run_tasks, waiting

def loaded(name):
    return name in sys.modules

if __name__ == "__main__":
    assert waiting() == 1
    load_ahead(1, ("this",))
    assert waiting() == 1
    load_ahead(2, ("oed.no_such_module", "xml.dom.expatbuilder"))
    assert waiting() == 2
    found = {}
    run_tasks(loaded, ["xml.dom.expatbuilder"] * 8, 2, found.__setitem__)
    assert any(found.values()) and not loaded("xml.dom.expatbuilder")
"""


@pytest.mark.slow
def test_tasks_find_modules_loaded(tmp_path):
    # In a process of its own: the pool is one for all tests.
    (tmp_path / "ahead.py").write_text(CODE)
    done = subprocess.run(
        [sys.executable, "ahead.py"], cwd=tmp_path, check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_run_needs_what_it_loads_ahead():
    # Of the modules' own names one mistyped would be found by nothing else.
    assert all(find_spec(one) is not None for one in LATER)
