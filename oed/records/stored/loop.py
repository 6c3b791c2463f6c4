"""What loop.json holds: the rounds of a loop, which it goes on from where it was stopped."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from oed.records.stored.parts import Entries, Name, Number, Positive, Stored, require_different


def _one_part(name: str) -> str:
    # Of whatever name somebody's logger gives, as long as it leads out of no folder.
    if not name or name in (".", "..") or set(name) & set("/\\\0"):
        raise ValueError(f"expected the name of a file, got {name!r}")
    return name


LogName = Annotated[str, AfterValidator(_one_part)]


def round_folder(number: int) -> str:
    """The folder of the n-th drive's design, and of the estimate from those before."""
    return f"round{number}"


class KnownParameter(Stored):
    """What is known of a parameter after a round; SI, None where there is no such number.

    `now` is its standard error, `wanted` the one to be reached, `next` the one predicted after another drive,
    `size` what relative errors refer to.
    """

    name: str
    unit: str | None
    value: Number | None
    now: Positive | None
    size: Positive | None
    wanted: Positive | None
    next: Positive | None


class LoopRound(Stored):
    """A drive: the folder of its design, the logs of it, and what is known of all drives up to this one."""

    folder: Name
    logs: list[LogName]
    known: Entries[KnownParameter]
    reason: str = ""

    @property
    def driven(self) -> bool:
        """Whether its logs are there, and what they say."""
        return bool(self.known)


class SeenLog(Stored):
    """A file of the logs' folder that is no log of a round: its size [bytes], and when it changed [ns]."""

    name: LogName
    size: Annotated[int, Field(ge=0)]
    changed: int


class StoredLoop(Stored):
    """A loop: what was asked for, its rounds, and how it stands.

    `study` is the study's hash without what says how logs are read; `seen` are files that were there before,
    or could not be read.
    """

    format: Literal[1]
    oed_version: str
    name: str
    study: str
    asked: dict[str, str]
    rounds: list[LoopRound]
    seen: list[SeenLog]
    reached: bool
    finished: bool
    reason: str

    @property
    def driven(self) -> list[LoopRound]:
        """The rounds whose logs have been estimated from."""
        return [one for one in self.rounds if one.driven]

    @property
    def folders(self) -> list[str]:
        """The folders of its rounds, and that of what was decided in the end."""
        return [round_folder(number) for number in range(1, len(self.rounds) + 2)]

    @property
    def logs(self) -> list[str]:
        """Names of the logs of all rounds."""
        return [name for one in self.rounds for name in one.logs]

    def _require(self) -> None:
        require_different("rounds", [one.folder for one in self.rounds])
        require_different("logs", self.logs)
