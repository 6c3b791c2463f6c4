"""Ctrl-C before the command runs and after it: no traceback, and an exit code that is true."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's"),
]
IMPORTING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "MODULE":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Finder())
"""
AT_EXIT = """
import signal, sys, threading, time
signal.signal(signal.SIGINT, signal.default_int_handler)

def late():
    threading.main_thread().join()
    signal.pthread_kill(threading.main_thread().ident, signal.NUMBER)
    time.sleep(5)

threading.Thread(target=late).start()
"""


def command(folder: Path, before: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command after some code, in a file that is called as the installed one."""
    program = folder / "oed"
    program.write_text(f"{before}\nfrom oed.cli import main\nsys.exit(main())\n")
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": root}
    return subprocess.run(
        [sys.executable, str(program), *arguments],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.mark.parametrize("module", ["lazy_loader", "oed.cli.program", "numpy", "casadi"])
def test_an_interrupt_while_modules_load_ends_without_traceback(tmp_path: Path, module: str):
    ended = command(tmp_path, IMPORTING.replace("MODULE", module), "init", "x.yaml", "--robot", "unicycle")
    assert ended.returncode == 1
    assert "Traceback" not in ended.stderr
    assert ended.stderr.startswith("interrupted")


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_after_the_command_leaves_its_exit_code(tmp_path: Path, number: str):
    # A thread that Python waits for keeps the process at its exit.
    ended = command(tmp_path, AT_EXIT.replace("NUMBER", number), "schema")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout
