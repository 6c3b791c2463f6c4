"""Random systems of equations: terms that stay bounded, responses that follow at once, and their units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .amounts import PLAIN, RATE, TEMPERATURE, Amount, Dimension, dimension, product, shuffled
from .quantities import log_uniform, one_of

Rng = np.random.Generator

DIMENSIONS: tuple[Dimension, ...] = (
    PLAIN,
    dimension(mol=1, m=-3),
    dimension(kg=1),
    TEMPERATURE,
    dimension(m=1),
    dimension(A=1),
    dimension(kg=1, m=-3),
)
STIFF = (100.0, 1e5)
"""How many times faster the fast part of a stiff system is."""
REUSED = 0.15
"""Share of parameters that are one that there is already, where one fits."""


@dataclass
class Draft:
    """A system that is being drawn.

    Attributes:
        rng: of all choices.
        time: by which rates are, SI.
        positive: whether states and inputs never are negative.
        dims: of all names.
        sizes: typical magnitudes of states, inputs and algebraic states, SI.
        stiff: whether a state is much faster than the others.
    """

    rng: Rng
    time: float
    positive: bool
    dims: dict[str, Dimension] = field(default_factory=dict)
    sizes: dict[str, float] = field(default_factory=dict)
    states: list[str] = field(default_factory=list)
    inputs: list[str] = field(default_factory=list)
    algebraic: list[str] = field(default_factory=list)
    parameters: dict[str, Amount] = field(default_factory=dict)
    define: dict[str, str] = field(default_factory=dict)
    rates: dict[str, str] = field(default_factory=dict)
    zeros: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    output_dims: dict[str, Dimension] = field(default_factory=dict)
    stiff: bool = False

    def parameter(self, letter: str, value: float, of: Dimension) -> str:
        """The name of a parameter of about that value."""
        near = [
            name
            for name, own in self.parameters.items()
            if own.dimension == of and 1 / 3 < own / value < 3 and own * value > 0
        ]
        if near and self.rng.random() < REUSED:
            return str(one_of(self.rng, near))
        name = f"{letter}{sum(own.startswith(letter) for own in self.parameters) + 1}"
        self.parameters[name] = Amount(value * log_uniform(self.rng, 0.5, 2), of)
        return name

    def rate(self) -> str:
        """A rate constant's name."""
        return self.parameter("k", log_uniform(self.rng, 0.2, 1.5) / self.time, RATE)

    def level(self, name: str) -> str:
        """A parameter of the size of a quantity."""
        return self.parameter("K", self.sizes[name], self.dims[name])

    def flow(self, name: str, share: float = 1.0) -> str:
        """A parameter of the size of a state's rate."""
        value = share * self.sizes[name] / self.time
        return self.parameter("v", value, product(self.dims[name], RATE))

    def gain(self, name: str, by: str, more: Dimension = PLAIN, size: float = 1.0) -> str:
        """A parameter that makes one quantity another, times what else."""
        of = product(product(self.dims[name], self.dims[by], -1), more)
        return self.parameter("b", size * self.sizes[name] / self.sizes[by], of)

    def add(self, kind: str, name: str, of: Dimension, size: float) -> None:
        """A state, an input or an algebraic state."""
        getattr(self, kind).append(name)
        self.dims[name], self.sizes[name] = of, size

    def defined(self, text: str) -> str:
        """The text, or the name of a definition that has it."""
        if self.rng.random() > 0.25:
            return text
        name = f"part{len(self.define) + 1}"
        self.define[name] = text
        return name


# --- terms of a state's rate ---


def _decay(draft: Draft, x: str, _: str) -> str:
    return f"- {draft.rate()} * {x}"


def _relaxation(draft: Draft, x: str, _: str) -> str:
    return f"+ {draft.defined(f'{draft.rate()} * ({draft.level(x)} - {x})')}"


def _saturating(draft: Draft, x: str, _: str) -> str:
    return f"- {draft.flow(x)} * {x} / ({draft.level(x)} + {x})"


def _hill(draft: Draft, x: str, _: str) -> str:
    level = draft.level(x)
    return f"- {draft.flow(x)} * {x}^2 / ({level}^2 + {x}^2)"


def _power(draft: Draft, x: str, _: str) -> str:
    n = draft.parameter("n", 1.0, PLAIN)
    return f"- {draft.flow(x)} * ({x} / {draft.level(x)})^{n}"


def _loss_with(draft: Draft, x: str, y: str) -> str:
    q = draft.parameter("q", 1 / (draft.sizes[y] * draft.time), product(RATE, draft.dims[y], -1))
    return f"- {draft.defined(f'{q} * {x} * {y}')}"


def _fed_by(draft: Draft, x: str, y: str) -> str:
    v = draft.flow(x)
    return f"+ {v} * {y} / ({draft.level(y)} + {y})"


def _constant(draft: Draft, x: str, _: str) -> str:
    return f"+ {draft.flow(x)}"


def _damped(draft: Draft, x: str, _: str) -> str:
    return f"- {draft.rate()} * {x} * (1 + ({x} / {draft.level(x)})^2)"


def _bounded(draft: Draft, x: str, y: str) -> str:
    function = one_of(draft.rng, ("tanh", "sin", "cos", "atan"))
    return f"+ {draft.flow(x)} * {function}({y} / {draft.level(y)})"


def _linear(draft: Draft, x: str, y: str) -> str:
    return f"+ {draft.gain(x, y, RATE, 0.7 / draft.time)} * {y}"


def _faded(draft: Draft, x: str, y: str) -> str:
    return f"+ {draft.flow(x)} * exp(-({y} / {draft.level(y)})^2)"


Term = Callable[[Draft, str, str], str]
LOSSES: tuple[Term, ...] = (_decay, _relaxation, _saturating, _hill, _power, _loss_with)
GAINS: tuple[Term, ...] = (_fed_by, _constant, _faded)
SIGNED_LOSSES: tuple[Term, ...] = (_decay, _relaxation, _damped)
SIGNED_GAINS: tuple[Term, ...] = (_bounded, _constant, _linear, _faded)


def _driven(draft: Draft, x: str, u: str) -> str:
    # What an input does to a state.
    if draft.dims[u] == TEMPERATURE and draft.sizes[u] > 200:
        energy = draft.parameter("E", 2000.0, TEMPERATURE)
        warm = draft.parameter("T", 300.0, TEMPERATURE)
        return f"- {draft.rate()} * exp({energy} * (1 / {warm} - 1 / {u})) * {x}"
    ways = [f"+ {draft.gain(x, u, RATE, 1 / draft.time)} * {u}"]
    if draft.positive:
        q = draft.parameter("q", 1 / (draft.sizes[u] * draft.time), product(RATE, draft.dims[u], -1))
        ways += [f"- {q} * {u} * {x}", f"+ {draft.flow(x)} * {u} / ({draft.level(u)} + {u})"]
    return str(one_of(draft.rng, ways))


# --- what has no derivative ---


def _add_algebraic(draft: Draft, by: str) -> None:
    rng, name = draft.rng, f"z{len(draft.algebraic) + 1}"
    own = draft.dims[by] if rng.random() < 0.5 else one_of(rng, DIMENSIONS)
    draft.add("algebraic", name, own, draft.sizes[by] if own == draft.dims[by] else log_uniform(rng, 0.1, 10))
    kind = one_of(
        rng, ("cubic", "exponential", "quadratic", "binding") if draft.positive else ("cubic", "exponential")
    )
    if kind == "cubic":
        text = f"{name} * (1 + ({name} / {draft.level(name)})^2) - {draft.gain(name, by)} * {by}"
    elif kind == "exponential":
        text = (
            f"exp({name} / {draft.level(name)}) - 1 + {name} / {draft.level(name)} - {by} / {draft.level(by)}"
        )
    elif kind == "quadratic":
        text = f"{name} * (1 + {name} / {draft.level(name)}) - {draft.gain(name, by)} * {by}"
    else:
        draft.dims[name], draft.sizes[name] = draft.dims[by], 0.1 * draft.sizes[by]
        sites, strength = (draft.parameter("K", draft.sizes[by], draft.dims[by]) for _ in range(2))
        text = f"({by} - {name}) * ({sites} - {name}) - {strength} * {name}"
    draft.zeros[name] = text


# --- what is read ---


def _add_output(draft: Draft, of: str) -> None:
    rng, name = draft.rng, f"y{len(draft.outputs) + 1}"
    sort = one_of(rng, ("plain", "plain", "gain", "offset", "ratio", "square", "with input"))
    text, own = of, draft.dims[of]
    if sort == "gain":
        factor = one_of(rng, DIMENSIONS)
        text, own = f"{draft.parameter('g', 1.0, factor)} * {of}", product(own, factor)
    elif sort == "offset":
        text = f"{of} + {draft.level(of)}"
    elif sort == "ratio" and draft.positive:
        ways = (f"{of} / ({draft.level(of)} + {of})", f"log(1 + {of} / {draft.level(of)})")
        text, own = one_of(rng, ways), PLAIN
    elif sort == "square":
        text, own = f"{of}^2", product(own, own)
    elif sort == "with input" and draft.inputs:
        u = one_of(rng, draft.inputs)
        text = f"{of} + {draft.gain(of, u)} * {u}"
    draft.outputs[name], draft.output_dims[name] = draft.defined(text), own


def _add_response(draft: Draft) -> None:
    rng, name, u = draft.rng, f"y{len(draft.outputs) + 1}", one_of(draft.rng, draft.inputs)
    size, of = log_uniform(rng, 0.1, 10), one_of(rng, DIMENSIONS)

    def share() -> str:
        return f"({u} / {draft.sizes[u]!r})" if not draft.dims[u] else f"({u} / {draft.level(u)})"

    a, b = (draft.parameter("a", size, of) for _ in range(2))
    ways = [
        f"{a} + {b} * {share()}",
        f"{a} + {b} * {share()} + {draft.parameter('c', size, of)} * {share()}^2",
        f"{a} * exp(-{share()}^2) + {b}",
        f"{a} * tanh({share()})",
    ]
    if draft.positive:
        ways += [
            f"{a} * {u} / ({draft.level(u)} + {u})",
            f"{a} * (1 - exp(-{share()})) + {b}",
            f"{a} * (exp(-{share()}) - exp(-3 * {share()}))",
            f"{a} * {u}^2 / ({draft.level(u)}^2 + {u}^2)",
        ]
    other = one_of(rng, draft.inputs)
    if other != u:
        ways.append(
            f"{a} * {u} / {draft.level(u)} + {b} * {u} * {other} / ({draft.level(u)} * {draft.level(other)})"
        )
    draft.outputs[name], draft.output_dims[name] = draft.defined(str(one_of(rng, ways))), of


def _add_inputs(draft: Draft, least: int) -> None:
    rng = draft.rng
    for place in range(int(rng.integers(least, 3))):
        warm = draft.positive and rng.random() < 0.15
        size = 300.0 if warm else log_uniform(rng, 0.1, 10)
        draft.add("inputs", f"u{place + 1}", TEMPERATURE if warm else one_of(rng, DIMENSIONS), size)


def draw_system(rng: Rng) -> Draft:
    """A system with states, or one that responds at once."""
    draft = Draft(rng, log_uniform(rng, 0.01, 1e4), bool(rng.random() < 0.6))
    dynamic = rng.random() < 0.7
    _add_inputs(draft, 0 if dynamic else 1)
    if not dynamic:
        if rng.random() < 0.3:
            _add_algebraic(draft, one_of(rng, draft.inputs))
            _add_output(draft, draft.algebraic[0])
        for _ in range(int(rng.integers(0 if draft.outputs else 1, 3))):
            _add_response(draft)
        _used(draft)
        return draft
    for place in range(int(rng.integers(1, 5))):
        draft.add("states", f"x{place + 1}", one_of(rng, DIMENSIONS), log_uniform(rng, 0.05, 20))
    if rng.random() < 0.15:
        _add_algebraic(draft, one_of(rng, draft.states))
    _add_rates(draft)
    seen = [*draft.states[::-1], *draft.algebraic]
    for _ in range(int(rng.integers(1, 4))):
        _add_output(draft, one_of(rng, seen))
    _used(draft)
    return draft


def _add_rates(draft: Draft) -> None:
    rng = draft.rng
    losses, gains = (LOSSES, GAINS) if draft.positive else (SIGNED_LOSSES, SIGNED_GAINS)
    draft.stiff = bool(rng.random() < 0.15)
    for place, x in enumerate(draft.states):
        others = [*draft.states[:place], *draft.algebraic] or draft.states
        terms = [one_of(rng, losses)(draft, x, one_of(rng, draft.states)), _decay(draft, x, x)]
        # What goes round in a circle may grow: only what comes before feeds linearly.
        terms += [one_of(rng, gains)(draft, x, one_of(rng, others)) for _ in range(int(rng.integers(1, 3)))]
        if draft.inputs and rng.random() < 0.7:
            terms.append(_driven(draft, x, one_of(rng, draft.inputs)))
        if draft.stiff and place == 0:
            fast = draft.parameter("f", log_uniform(rng, *STIFF) / draft.time, RATE)
            target = (
                f"{draft.gain(x, draft.states[-1])} * {draft.states[-1]}"
                if place + 1 < len(draft.states)
                else draft.level(x)
            )
            terms = [f"+ {fast} * ({target} - {x})"]
        text = " ".join(terms[at] for at in rng.permutation(len(terms)))
        draft.rates[x] = text.removeprefix("+ ")


def _used(draft: Draft) -> None:
    # Parameters that were drawn for what was not taken are left out.
    texts = " ".join(
        [*draft.define.values(), *draft.rates.values(), *draft.zeros.values(), *draft.outputs.values()]
    )
    words = set(texts.replace("(", " ").replace(")", " ").replace("^", " ").split())
    draft.parameters = {name: own for name, own in draft.parameters.items() if name in words}


def written_system(draft: Draft, begins: dict[str, Any]) -> dict[str, Any]:
    """The study's key."""
    rng = draft.rng
    found: dict[str, Any] = {"kind": "equations"}
    if draft.states:
        found |= {"states": begins, "derivatives": shuffled(rng, draft.rates)}
        if draft.algebraic or draft.stiff or rng.random() < 0.08:
            found["integrator"] = "radau"
            found |= {"substeps": int(rng.integers(2, 5))} if rng.random() < 0.5 else {}
        elif rng.random() < 0.5:
            found["substeps"] = int(rng.integers(4, 13))
    if draft.inputs:
        found["inputs"] = {name: Amount(1.0, draft.dims[name]).unit for name in draft.inputs}
    if draft.algebraic:
        found["algebraic_states"] = {
            name: Amount(0.1 * draft.sizes[name], draft.dims[name]) for name in draft.algebraic
        }
        found["algebraic"] = draft.zeros
    found["parameters"] = shuffled(rng, draft.parameters)
    if draft.define:
        found["define"] = shuffled(rng, draft.define)
    return {**found, "outputs": draft.outputs}
