"""The study file: its keys, checked, and written for a robot."""

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
_MOVED = ("load_study", "parse_study")


def __getattr__(name: str) -> object:
    if name in _MOVED:
        raise ImportError(f"oed.study.{name} is now oed.{name}")
    return _public(name)
