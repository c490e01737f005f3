"""Constraints between parameters, written as text: `mu * D1 <= 2`, `0 < C10 + C01`.  Read as data, never executed."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

MAX_CONDITION_CHARACTERS = 200  # of a condition as somebody writes it: more is none
Number = np.ndarray | np.float64
_BINARY: dict[type[ast.operator], Callable[[Number, Number], Number]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY: dict[type[ast.unaryop], Callable[[Number], Number]] = {ast.USub: np.negative, ast.UAdd: np.positive}
EXPRESSION_FUNCTIONS: dict[str, Callable[[Number], Number]] = {
    "sqrt": np.sqrt,
    "log": np.log,
    "exp": np.exp,
    "abs": np.abs,
}
_COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
Value = Callable[[Mapping[str, np.ndarray]], Number]


@dataclass(frozen=True, eq=False)
class Condition:
    """An inequality between parameters, in their units; `excess` gives by how much it is violated.

    `words` say what it means, where somebody has said so.
    """

    text: str
    _gaps: tuple[tuple[Value, bool], ...]
    words: str = ""

    def excess(self, theta: Mapping[str, np.ndarray]) -> np.ndarray:
        """How far values (n,) by name violate it (n,): the difference of its sides, at most 0 where it holds."""
        with np.errstate(all="ignore"):
            each = [self._size(gap(theta), strict) for gap, strict in self._gaps]
        return np.max(np.broadcast_arrays(*each), axis=0)  # of a chain one pair may be of numbers alone

    def holds(self, theta: Mapping[str, np.ndarray]) -> np.ndarray:
        """Mask (n,) of the values that respect it; one that cannot be computed does not."""
        return self.excess(theta) <= 0

    @staticmethod
    def _size(gap: Number, strict: bool) -> np.ndarray:
        gap = np.where(np.isnan(gap), np.inf, gap)
        return np.where(gap == 0, np.finfo(float).tiny, gap) if strict else gap


def read_condition(text: str, names: Sequence[str], words: str = "") -> Condition:
    """The condition that `text` states: expressions of `names`, numbers, + − * / **, sqrt, log, exp, abs, compared.

    Raises ValueError for anything else, naming what is not understood and what there is.
    """
    if len(text) > MAX_CONDITION_CHARACTERS:
        raise ValueError(f"a constraint has at most {MAX_CONDITION_CHARACTERS} characters, not {len(text)}")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f"{text!r} is not an inequality such as {names[0]} <= 1") from None
    if not isinstance(tree, ast.Compare) or not all(isinstance(o, _COMPARISONS) for o in tree.ops):
        raise ValueError(f"{text!r} is not an inequality (<, <=, >, >=) such as {names[0]} <= 1")
    sides = [_value(side, tuple(names)) for side in (tree.left, *tree.comparators)]
    if not any(isinstance(node, ast.Name) and node.id in names for node in ast.walk(tree)):
        raise ValueError(f"{text!r} names no parameter; there are {', '.join(names)}")
    gaps = []
    for a, b, op in zip(sides, sides[1:], tree.ops, strict=False):
        first, second = (a, b) if isinstance(op, ast.Lt | ast.LtE) else (b, a)
        gaps.append((_difference(first, second), isinstance(op, ast.Lt | ast.Gt)))
    return Condition(text.strip(), tuple(gaps), words)


def read_expression(text: str, names: Sequence[str]) -> Value:
    """The value, by those of `names`, of an expression of them, numbers, + − * / **, sqrt, log, exp, abs.

    Raises ValueError as :func:`read_condition`.
    """
    try:
        tree = ast.parse(text.strip()[: MAX_CONDITION_CHARACTERS + 1], mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(
            f"{text[:MAX_CONDITION_CHARACTERS]!r} is no expression such as 2 / {names[0] if names else 'K'}"
        ) from None
    return _value(tree, tuple(names))


def _difference(a: Value, b: Value) -> Value:
    return lambda theta: a(theta) - b(theta)


def _value(node: ast.expr, names: tuple[str, ...]) -> Value:
    match node:
        case ast.Constant(value=number) if isinstance(number, int | float) and not isinstance(number, bool):
            if not abs(number) < 1e300:
                raise ValueError(f"{number} is too large for an expression")
            constant = np.float64(number)
            return lambda theta: constant
        case ast.Name(id=name) if name in names:
            return lambda theta: np.asarray(theta[name], float)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            f, a, b = _BINARY[type(op)], _value(left, names), _value(right, names)
            return lambda theta: f(a(theta), b(theta))
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
            g, c = _UNARY[type(op)], _value(operand, names)
            return lambda theta: g(c(theta))
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in EXPRESSION_FUNCTIONS:
            h, e = EXPRESSION_FUNCTIONS[name], _value(argument, names)
            return lambda theta: h(e(theta))
    what = ast.unparse(node)
    known = f"parameters {', '.join(names)}, numbers, + - * / **, {', '.join(EXPRESSION_FUNCTIONS)}"
    raise ValueError(f"{what!r} is not understood in an expression; there are {known}")
