"""Damage to YAML and JSON: types, keys, names, nesting, aliases."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import yaml

from .text import Damage

Rng = np.random.Generator
Key = tuple[Any, Any]
"""A container, and a key or index in it."""

ODD_VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1.5,
    1e300,
    -1e300,
    float("nan"),
    float("inf"),
    10**4200,
    "",
    "text",
    "5 parsecs",
    "1e300 m",
    "5 m**(9**9**9)",
    "../../evil",
    "/etc/passwd",
    "a\x1b[31mb",
    "x" * 300,
    [],
    {},
    [[]],
    [None],
    ["text"],
    [1, 2, 3],
    {"text": 1},
    {"kind": "text"},
)


def places(tree: Any) -> Iterator[Key]:
    """Every value of a tree by its container."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in pairs:
        yield tree, key
        yield from places(value)


def _some_place(rng: Rng, tree: Any) -> Key:
    found = list(places(tree))
    return found[int(rng.integers(len(found)))]


def odd_value(rng: Rng, tree: Any) -> Any:
    """A value of another type, or far from what it was."""
    container, key = _some_place(rng, tree)
    container[key] = ODD_VALUES[int(rng.integers(len(ODD_VALUES)))]
    return tree


def missing_key(rng: Rng, tree: Any) -> Any:
    """A key or an entry missing."""
    container, key = _some_place(rng, tree)
    del container[key]
    return tree


def other_key(rng: Rng, tree: Any) -> Any:
    """A key by another name."""
    named = [(container, key) for container, key in places(tree) if isinstance(container, dict)]
    container, key = named[int(rng.integers(len(named)))]
    names = (f"{key}_", key.upper(), "", "kind", "x" * 300, "../../evil")
    container[names[int(rng.integers(len(names)))]] = container.pop(key)
    return tree


def moved_value(rng: Rng, tree: Any) -> Any:
    """A value in the place of another."""
    (one, key), (other, place) = _some_place(rng, tree), _some_place(rng, tree)
    one[key] = json.loads(json.dumps(other[place]))
    return tree


def deeper(rng: Rng, tree: Any) -> Any:
    """A value within very many lists."""
    container, key = _some_place(rng, tree)
    value = container[key]
    for _ in range(int(rng.integers(1, 60))):
        value = [value]
    container[key] = value
    return tree


TREES: tuple[Callable[[Rng, Any], Any], ...] = (
    odd_value,
    odd_value,
    odd_value,
    missing_key,
    other_key,
    moved_value,
    deeper,
)


def in_yaml(change: Callable[[Rng, Any], Any]) -> Damage:
    """A change of a tree as damage to a YAML file."""
    return lambda rng, data: yaml.safe_dump(change(rng, yaml.safe_load(data)), sort_keys=False).encode()


def in_json(change: Callable[[Rng, Any], Any]) -> Damage:
    """The same to a JSON file."""
    return lambda rng, data: json.dumps(change(rng, json.loads(data))).encode()


def yaml_trap(rng: Rng, data: bytes) -> bytes:
    """Something that only YAML can hold: aliases that multiply or recur, tags, odd keys, deep nesting."""
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12)
    )
    merges = "b0: &b0 {x: 1}\n" + "".join(
        f"b{k}: &b{k} {{<<: [{', '.join([f'*b{k - 1}'] * 9)}], y{k}: 1}}\n" for k in range(1, 9)
    )
    traps = (
        bomb,
        bomb + "limits: *a11\n",
        merges,
        "solvers: &s [*s]\n",
        "robot: &r {kind: *r}\n",
        "limits: &l {workspace: *l}\n",
        "baselines: " + "[" * 3000 + "]" * 3000 + "\n",
        "baselines: " + "{a: " * 2000 + "1" + "}" * 2000 + "\n",
        "? [1, 2]\n: 3\n",
        "? {a: 1}\n: 3\n",
        "seed: !!python/object/apply:os.system ['true']\n",
        "seed: !!int text\n",
        "seed: !!float text\n",
        "seed: !!timestamp text\n",
        "seed: !!binary '***'\n",
        "seed: 2001-13-45\n",
        "name: 2001-02-30\n",
        "seed: " + "9" * 5000 + "\n",
        "seed: 1:99:99\n",
        "seed: 0b2\n",
        "--- \na: 1\n--- \nb: 2\n",
        "%YAML 9.9\n---\n",
        "name: *nothing\n",
        "<<: 3\n",
    )
    trap = traps[int(rng.integers(len(traps)))].encode()
    key = trap.split(b":")[0]
    # A key of the study is replaced, not given twice.
    lines = data.splitlines(keepends=True)
    kept = [line for line in lines if not line.startswith(key + b":")]
    return trap + b"".join(kept) if rng.random() < 0.5 else b"".join(kept) + trap
