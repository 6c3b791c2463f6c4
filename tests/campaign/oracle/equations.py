"""Systems given by texts: evaluated by Python's own parser, and followed by Runge-Kutta or Radau steps.

Arrays of states are (states, copies, columns): columns are whatever is followed side by side, copies the
nominal system and one for every derivative, displaced by an imaginary step.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from types import CodeType
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

STEP = 1e-40
"""Imaginary displacement."""
ITERATIONS, CLOSE, HALVED = 60, 1e-13, 12
"""Of Newton's method at most; share of the unknowns by which the last changes them; how often a step that
leads away is halved."""
CORRECTIONS = 3
"""Linear steps that bring the displaced copies to their own roots."""
NODES = np.array([(4 - 6**0.5) / 10, (4 + 6**0.5) / 10, 1.0])
"""Of the Radau IIA method of order 5 [Hairer and Wanner, Solving Ordinary Differential Equations II]."""
_ROOT = 6**0.5
STAGES = np.array(
    [
        [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
        [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
        [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
    ]
)
"""Its matrix."""
USUAL_STEPS = {"runge_kutta": 10, "radau": 4}


def _of_reals(function: Any) -> Any:
    # Complex numbers below 0 have a logarithm, those that they stand for have none.
    def found(value: Any) -> Any:
        return np.where(np.real(value) >= 0, function(value), np.nan)

    return found


def _power(base: Any, exponent: Any) -> Any:
    exponent = np.asarray(exponent)
    whole = (exponent.imag == 0) & (exponent.real == np.rint(exponent.real))
    # Nor is there one below 0; and at 0 itself no derivative of small powers.
    steep = (np.real(base) == 0) & (exponent.real < 1)
    none = ~whole & ((np.real(base) < 0) | steep)
    return np.where(none, np.nan, np.power(base, exponent))


FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, name) for name in ("exp", "sin", "cos", "tanh", "sinh", "cosh")},
    **{name: _of_reals(getattr(np, name)) for name in ("log", "sqrt")},
    "atan": np.arctan,
    "pi": np.pi,
    "power": _power,
}


class NotSolved(ArithmeticError):
    """No root was found."""


class Names(dict[str, Any]):
    """Values by name, definitions where they are asked for."""

    def __init__(self, values: Mapping[str, Any], define: Mapping[str, CodeType]) -> None:
        super().__init__(values)
        self.define = define

    def __missing__(self, name: str) -> Any:
        if name not in self.define:
            raise KeyError(name)
        self[name] = found = eval(self.define[name], FUNCTIONS, self)
        return found


def compiled(text: str) -> CodeType:
    """An expression as code: powers are written ^."""
    tree = _Powers().visit(ast.parse(text.replace("^", "**"), "expression", "eval"))
    return compile(ast.fix_missing_locations(tree), "expression", "eval")


class _Powers(ast.NodeTransformer):
    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Pow):
            return node
        return ast.Call(ast.Name("power", ast.Load()), [node.left, node.right], [])


class Equations:
    """What a study's key `system` says, SI numbers in place of quantities."""

    def __init__(self, spec: Mapping[str, Any]) -> None:
        self.states, self.inputs = list(spec.get("states", {})), list(spec.get("inputs", {}))
        self.parameters = list(spec["parameters"])
        self.nominal = np.array(list(spec["parameters"].values()), dtype=float)
        self.guesses = np.array(list(spec.get("algebraic_states", {}).values()), dtype=float)
        self.algebraic = list(spec.get("algebraic_states", {}))
        self._define = {name: compiled(text) for name, text in spec.get("define", {}).items()}
        self._rates = [compiled(spec["derivatives"][name]) for name in self.states]
        self._zeros = [compiled(spec["algebraic"][name]) for name in self.algebraic]
        self._outputs = {name: compiled(text) for name, text in spec["outputs"].items()}
        self.integrator = spec.get("integrator", "runge_kutta")
        self.substeps = spec.get("substeps", USUAL_STEPS[self.integrator])

    def names(self, x: Any, u: Any, p: Any, z: Any = ()) -> Names:
        """The values of all names but outputs'."""
        pairs = [*zip(self.states, x, strict=True), *zip(self.inputs, u, strict=True)]
        pairs += [*zip(self.parameters, p, strict=True), *zip(self.algebraic, z, strict=bool(len(z)))]
        return Names(dict(pairs), self._define)

    def value(self, text: str, x: Any, u: Any, p: Any) -> Array:
        """An expression of states, inputs, parameters, definitions and outputs."""
        z = self.solved(x, u, p) if self.algebraic else ()
        names = self.names(x, u, p, z)
        names.define = {**self._define, **self._outputs}
        return np.asarray(eval(compiled(text), FUNCTIONS, names))

    def rates(self, x: Array, u: Any, p: Any, z: Any = ()) -> Array:
        """Derivatives of the states by time."""
        return _stacked(self._rates, self.names(x, u, p, z), _shape(x, z))

    def zeros(self, x: Array, u: Any, p: Any, z: Array) -> Array:
        """What is 0."""
        return _stacked(self._zeros, self.names(x, u, p, z), _shape(x, z, *u, *p))

    def outputs(self, x: Array, u: Any, p: Any) -> dict[str, Array]:
        """Of all that there are."""
        z = self.solved(x, u, p) if self.algebraic else ()
        names = self.names(x, u, p, z)
        shape = _shape(x, *u, *p)
        return {
            name: np.broadcast_to(eval(code, FUNCTIONS, names), shape) for name, code in self._outputs.items()
        }

    def solved(self, x: Array, u: Any, p: Any) -> Array:
        """The algebraic states (a, copies, columns), from their guesses."""
        shape = _shape(x, *u, *p)
        size, columns = len(self.guesses), shape[-1]
        given = np.broadcast_to(np.real(x[:, :1]), (len(x), 1, columns)) if len(x) else x
        first, own = [np.real(one) for one in u], [np.real(one[:1]) for one in p]
        z = np.broadcast_to(self.guesses[:, None, None], (size, 1, columns)).copy()

        def residual(unknowns: Array) -> Array:
            return self.zeros(given, first, own, unknowns)

        z, slopes = _newton(residual, z)
        z = np.broadcast_to(z, (size, *shape)).astype(complex)
        for _ in range(CORRECTIONS):
            z = z - _divided(slopes, self.zeros(x, u, p, z))
        return z

    def step(self, x: Array, u: Any, p: Any, period: float) -> Array:
        """The states after a period."""
        if not self.states:
            return x
        length = period / self.substeps
        z = self.solved(x, u, p) if self.algebraic else np.zeros((0, *x.shape[1:]), dtype=complex)
        for _ in range(self.substeps):
            if self.integrator == "radau":
                x, z = self._radau(x, z, u, p, length)
            else:
                x = self._runge_kutta(x, u, p, length)
        return x

    def _runge_kutta(self, x: Array, u: Any, p: Any, length: float) -> Array:
        first = self.rates(x, u, p)
        second = self.rates(x + length / 2 * first, u, p)
        third = self.rates(x + length / 2 * second, u, p)
        fourth = self.rates(x + length * third, u, p)
        return x + length * (first + 2 * (second + third) + fourth) / 6

    def _radau(self, x: Array, z: Array, u: Any, p: Any, length: float) -> tuple[Array, Array]:
        count, size = len(x), len(x) + len(z)

        def residual(unknowns: Array, x: Array, p: Any) -> Array:
            # Of (3 size, copies, columns).
            each = np.split(unknowns, 3)
            rates = [self.rates(one[:count], u, p, one[count:]) for one in each]
            rows = []
            for weights, one in zip(STAGES, each, strict=True):
                reached = sum(weight * rate for weight, rate in zip(weights, rates, strict=True))
                rows.append(one[:count] - x - length * reached)
                if len(z):
                    rows.append(self.zeros(one[:count], u, p, one[count:]))
            return np.concatenate(rows)

        first, own = np.real(x[:, :1]), [np.real(one[:1]) for one in p]
        start = np.concatenate([first, np.real(z[:, :1])])
        found, slopes = _newton(lambda unknowns: residual(unknowns, first, own), np.concatenate([start] * 3))
        found = np.broadcast_to(found, (3 * size, *x.shape[1:])).astype(complex)
        for _ in range(CORRECTIONS):
            found = found - _divided(slopes, residual(found, x, p))
        return found[2 * size : 2 * size + count], found[2 * size + count :]


def _newton(residual: Any, start: Array) -> tuple[Array, Array]:
    # The real root (k, 1, columns) of every column by itself, and its Jacobian (columns, k, k).
    now = start
    for _ in range(ITERATIONS):
        slopes, value = _slopes(residual, now)
        change = _divided(slopes, value)
        size = np.abs(now) + np.abs(change)
        if np.all(np.abs(change) <= CLOSE * np.maximum(size, 1e-300)):
            return now - change, _slopes(residual, now - change)[0]
        now = _damped(residual, slopes, now, change)
    if np.all(np.abs(change) <= 1e-9 * size):
        return now, _slopes(residual, now)[0]
    raise NotSolved


def _damped(residual: Any, slopes: Array, now: Array, change: Array) -> Array:
    # A share of the step in each column, so that the next would be shorter.
    share = np.ones((1, 1, now.shape[2]))
    sizes = np.abs(now) + np.abs(change) + 1e-300
    least = ((change / sizes) ** 2).sum(axis=0, keepdims=True)
    for _ in range(HALVED):
        there = now - share * change
        with np.errstate(all="ignore"):
            further = _divided(slopes, residual(there)) / sizes
            bad = ~((further**2).sum(axis=0, keepdims=True) <= least)
        if not bad.any():
            break
        share = np.where(bad, share / 2, share)
    return now - share * change


def _slopes(residual: Any, at: Array) -> tuple[Array, Array]:
    # By the complex step, one copy for each unknown.
    size, _, columns = at.shape
    moved = np.broadcast_to(at, (size, size, columns)) + 1j * STEP * np.eye(size)[:, :, None]
    found = residual(moved)
    return np.imag(found).transpose(2, 0, 1) / STEP, np.real(found[:, :1])


def _divided(slopes: Array, right: Array) -> Array:
    # (columns, k, k) and (k, copies, columns).
    try:
        return np.linalg.solve(slopes, right.transpose(2, 0, 1)).transpose(1, 2, 0)
    except np.linalg.LinAlgError:
        raise NotSolved from None


def _stacked(codes: Sequence[CodeType], names: Names, shape: tuple[int, ...]) -> Array:
    if not codes:
        return np.zeros((0, *shape))
    each = [eval(code, FUNCTIONS, names) for code in codes]
    found = np.empty((len(each), *shape), dtype=np.result_type(*each))
    for place, one in enumerate(each):
        found[place] = one
    return found


def _shape(*arrays: Any) -> tuple[int, ...]:
    # Of one value of what is given: of (k, copies, columns) the last two axes.
    shapes = [np.shape(one)[1:] if np.ndim(one) == 3 else np.shape(one) for one in arrays if np.size(one)]
    return np.broadcast_shapes((1, 1), *shapes)
