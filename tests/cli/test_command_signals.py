"""Ctrl-C before the command runs and after it: no traceback, and an exit code that is true."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from studies import GENETIC, small, write_study

from oed.records.record import load_record

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
ANSWERED = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
"""Ctrl-C is answered even where the tests ignore it."""
AT_EXIT = """
import signal, sys, threading, time
signal.signal(signal.SIGINT, signal.default_int_handler)

def late():
    threading.main_thread().join()
    signal.pthread_kill(threading.main_thread().ident, signal.NUMBER)
    time.sleep(1)

threading.Thread(target=late).start()
"""


def command(folder: Path, before: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command after some code, in a file that is called as the installed one."""
    process = started(folder, before, *arguments)
    out, err = process.communicate(timeout=60)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def started(folder: Path, before: str, *arguments: str) -> subprocess.Popen[str]:
    """Start the same in a group of processes of its own."""
    program = folder / "oed"
    program.write_text(
        f"{before}\nfrom oed.cli import main\nif __name__ == '__main__':\n    sys.exit(main())\n"
    )
    return subprocess.Popen(
        [sys.executable, str(program), *arguments],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
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


def test_a_second_interrupt_of_two_workers_keeps_what_is_done(tmp_path: Path):
    slow = "{kind: genetic, population: 20, generations: 100000"
    write_study(tmp_path, small(solvers=f"{GENETIC}, {slow}, name: slow}}, {slow}, name: slower}}"))
    process = started(tmp_path, ANSWERED, "run", "study.yaml", "--out", "out", "--workers", "2", "--quiet")
    kept = tmp_path / ".out.oed" / "draft" / "out" / "record.json"
    give_up = time.monotonic() + 60
    while not kept.exists() and time.monotonic() < give_up:
        time.sleep(0.02)
    began = time.monotonic()
    # A terminal sends Ctrl-C to the workers, too.
    os.killpg(process.pid, signal.SIGINT)
    time.sleep(0.2)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert time.monotonic() - began < 10
    assert process.returncode == 1
    assert "Traceback" not in err
    # Beside it, where the second one came before the folder had its name.
    (place,) = (one for one in (tmp_path / "out", tmp_path / "out.interrupted") if one.exists())
    assert load_record(place).results[0].name == "genetic"
    assert place.name in err
