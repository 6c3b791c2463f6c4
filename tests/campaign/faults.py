"""Faults: signals and full disks while `oed run` works over a finished folder.

What was there before has to be unchanged or fully replaced, no process may be left, an interrupt ends within
seconds, and nothing of it is a traceback.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .cases import SECONDS, Verdict, quoted
from .damage.material import STUDIES, copied
from .damage.running import environment
from .generator.quantities import log_uniform, one_of

Rng = np.random.Generator

STOPS = "stops within 3 s"
PROMPT = 3.0
"""Seconds after which an interrupted run has to have ended."""
SETTLED = 2.0
"""Seconds within which workers have to follow their parent, however that ended."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
DISKS = 0.3
"""Share of faults that are full disks."""
LONG = STUDIES["plain"].replace("starts: 1, perturbations: 0", "starts: 200, perturbations: 0")
"""A search long enough for worker processes to be worth their start."""
TOKEN = "OED_CAMPAIGN_TOKEN"
FULL_DISK = """\
import builtins, errno, io, os, sys
left = int(sys.argv.pop(1))
class Full(io.FileIO):
    def write(self, data):
        global left
        if self.name_is_ours:
            left -= len(bytes(data))
            if left < 0:
                raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)
def opened(file, mode="r", buffering=-1, encoding=None, errors=None, newline=None, closefd=True, opener=None):
    if not set(mode) & set("wax+"):
        return plain(file, mode, buffering, encoding, errors, newline, closefd, opener)
    raw = Full(file, mode.replace("b", "").replace("t", ""), closefd, opener)
    place = os.readlink(f"/proc/self/fd/{raw.fileno()}")
    raw.name_is_ours = place.startswith(os.getcwd())
    both = io.BufferedWriter(raw) if "+" not in mode else io.BufferedRandom(raw)
    return both if "b" in mode else io.TextIOWrapper(both, encoding, errors, newline)
plain, builtins.open, io.open = builtins.open, opened, opened
from oed.cli import main
sys.exit(main(sys.argv[1:]))
"""
"""Runs the command line on a disk on which so many bytes are free."""


@dataclass(frozen=True)
class _Plan:
    """How a run is disturbed.

    Attributes:
        sign: the signal.
        study: what is run.
        delay: seconds after the start, or, where `writing`, after the first change of the folder.
        writing: whether the signal waits for that change.
    """

    sign: signal.Signals
    study: str
    delay: float
    writing: bool


def fault_case(rng: Rng, material: Path, *, quick: bool = False) -> Iterator[Verdict]:
    """One disturbed run over a finished folder; `quick` ones are not timed, for other work goes on."""
    with tempfile.TemporaryDirectory(prefix="oed-campaign-") as place:
        folder = Path(place) / "work"
        copied(material, folder)
        if rng.random() < DISKS:
            yield from _full_disk(rng, folder)
        else:
            yield from (one for one in _signalled(rng, folder) if not quick or one.asked != STOPS)


# --- signals ---


def _signalled(rng: Rng, folder: Path) -> Iterator[Verdict]:
    plan = _plan(rng)
    (folder / "plain.yaml").write_text(plan.study, encoding="utf-8")
    before, token = snapshot(folder / "plain"), uuid.uuid4().hex
    with (folder / ".err").open("w+") as err:
        process = _started(folder, token, err)
        sent = _sent(process, plan, folder / "plain")
        try:
            process.wait(timeout=SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        seconds = time.monotonic() - sent
        time.sleep(0.0 if process.returncode == 0 else SETTLED / 4)
        orphans = _left_behind(token, SETTLED)
        err.seek(0)
        said = err.read()
    what = f"{plan.sign.name} {'at the first file' if plan.writing else f'after {plan.delay:.2f} s'}"
    late = plan.sign is not signal.SIGKILL and seconds > PROMPT
    yield Verdict(STOPS, f"{what}: {seconds:.1f} s" if late else "")
    yield Verdict("no process left", f"{what}: {len(orphans)}" if orphans else "")
    yield _without_traceback(what, said)
    yield _kept(what, folder / "plain", before)


def _without_traceback(what: str, said: str) -> Verdict:
    last = quoted(said.strip().splitlines()[-1]) if "Traceback" in said else ""
    return Verdict("no traceback", last and f"{what}: {last}")


def _kept(what: str, folder: Path, before: dict[str, str]) -> Verdict:
    wrong = "; ".join(damaged_results(folder, before))
    return Verdict("finished results kept or replaced", wrong and f"{what}: {wrong}")


def _plan(rng: Rng) -> _Plan:
    sign = one_of(rng, SIGNALS)
    if rng.random() < 0.5:
        # While it saves: the quick study comes to that soon.
        return _Plan(sign, STUDIES["plain"], log_uniform(rng, 1e-4, 0.1), writing=True)
    return _Plan(sign, one_of(rng, (STUDIES["plain"], LONG)), float(rng.uniform(0.2, 8.0)), writing=False)


def _started(folder: Path, token: str, err: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "oed", "run", "plain.yaml", "--out", "plain", "--workers", "2", "--seed", "7"],
        cwd=folder,
        env=environment(**{TOKEN: token}),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=err,  # type: ignore[arg-type]
        # A shell in the background has its children ignore interrupts.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def _sent(process: subprocess.Popen[bytes], plan: _Plan, results: Path) -> float:
    # Sends the signal, unless the run is over before; when [s].
    if plan.writing:
        first, deadline = _stamp(results), time.monotonic() + SECONDS
        while process.poll() is None and time.monotonic() < deadline and _stamp(results) == first:
            time.sleep(0.0005)
    time.sleep(plan.delay)
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(plan.sign)
    return time.monotonic()


def _stamp(results: Path) -> tuple[int, ...]:
    # Of the folder and the one around it: whichever way results come to their place, one of them changes.
    return tuple(os.stat(place).st_mtime_ns for place in (results, results.parent) if place.exists())


def _left_behind(token: str, seconds: float) -> list[int]:
    # Processes of a run that are still there after some time; they are ended here.
    deadline = time.monotonic() + seconds
    while (found := _marked(token)) and time.monotonic() < deadline:
        time.sleep(0.05)
    for number in found:
        with contextlib.suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    return found


def _marked(token: str) -> list[int]:
    # By the environment that all processes of a run inherit.
    mark, found = f"{TOKEN}={token}".encode(), []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                if mark in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
    return found


# --- full disks ---


def _full_disk(rng: Rng, folder: Path) -> Iterator[Verdict]:
    before, free = snapshot(folder / "plain"), int(log_uniform(rng, 10, 300_000))
    command = ["run", "plain.yaml", "--out", "plain", "--workers", "1", "--seed", "7", "--quiet"]
    if rng.random() < 0.5:
        what = f"files of at most {free} bytes"
        found = _limited([sys.executable, "-m", "oed", *command], folder, free)
    else:
        what = f"a disk with {free} bytes left"
        found = _limited([sys.executable, "-c", FULL_DISK, str(free), *command], folder, None)
    yield _without_traceback(what, found.stderr)
    lost = bool(found.returncode) and "ipopt" not in found.stdout
    yield Verdict("results printed though not saved", f"{what}: not a line of them" if lost else "")
    yield Verdict(
        "exit code 0, 1 or 2", "" if found.returncode in (0, 1, 2) else f"{what}: {found.returncode}"
    )
    yield _kept(what, folder / "plain", before)


def _limited(command: list[str], folder: Path, most: int | None) -> subprocess.CompletedProcess[str]:
    def limit() -> None:
        if most is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    return subprocess.run(
        command,
        cwd=folder,
        env=environment(PYTHONDONTWRITEBYTECODE="1"),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        preexec_fn=limit,
        check=False,
    )


# --- what was there before ---


def snapshot(folder: Path) -> dict[str, str]:
    """Fingerprints of all results in a folder: its record and its paths."""
    files = sorted([*folder.glob("*.json"), *folder.glob("*.csv")])
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def damaged_results(folder: Path, before: dict[str, str]) -> Iterator[str]:
    """What is wrong with a folder of finished results: neither as it was, nor fully replaced."""
    after = snapshot(folder) if folder.is_dir() else {}
    if all(after.get(name) == mark for name, mark in before.items()):
        return
    try:
        record = json.loads((folder / "record.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        yield f"no record any more ({type(error).__name__})"
        return
    if record["interrupted"] or any(one["objective"] is None for one in record["results"]):
        yield "an unfinished record took the place of a finished one"
    elif after.get("record.json") == before["record.json"]:
        names = [name for name, mark in before.items() if after.get(name) != mark]
        yield f"the old record beside other files ({', '.join(names)})"
    for one in record["results"]:
        file = folder / str(one["trajectory"])
        if one["trajectory"] and not (file.is_file() and _agrees(file, one["drive"]["poses"])):
            yield f"{file.name} is not of its record"


def _agrees(file: Path, poses: list[list[float]]) -> bool:
    rows = [line.split(",") for line in file.read_text(encoding="utf-8").splitlines()]
    width = len(poses[0])
    found = np.array([[float(cell) for cell in row[-width:]] for row in rows[1:]])
    return found.shape == np.shape(poses) and bool(np.allclose(found, poses, atol=1e-8))
