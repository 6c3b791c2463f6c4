"""Other packages: heavy libraries that only some work needs, imported when first used; versions installed."""

from __future__ import annotations

import importlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from oed.foundation.errors import UserMistake


def extra(module: str, name: str, purpose: str) -> Any:
    """The module, which belongs to the extra `name` of the package.

    Args:
        module: to import, e.g. "rosbags.highlevel".
        name: of the extra that installs it, e.g. "ros".
        purpose: what needs it, for the error: "reading ROS 2 bags".

    Raises:
        UserMistake: it is not installed; says how to.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != module.partition(".")[0]:
            raise
        raise UserMistake(f"{purpose} needs an extra of the package: pip install 'oed[{name}]'") from None


@cache
def package_version(package: str) -> str:
    """The version of an installed package, "unknown" of one that is not."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
