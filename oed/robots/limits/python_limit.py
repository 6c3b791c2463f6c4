"""A limit of the user's own, named in a study by where its class stands."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import ConfigDict

from oed.foundation.own.part import OwnPart
from oed.kernel.limit import Limit


class PythonLimit(OwnPart, Limit):
    """The limit that `object` ("my_module:MyLimit") makes of all further keys."""

    model_config = ConfigDict(extra="allow")

    name: ClassVar[str] = "own"
    noun = "limit"
    kind: Literal["python"]
