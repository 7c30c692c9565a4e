"""Expressions over arrays, as a language model writes them: parsed and interpreted node by node, never run.

Numbers, arithmetic, comparisons, logic and a few functions mean the same as in Python and numpy. A :class:`Vocabulary`
defines names, attributes and further functions. Anything else is refused with a reason.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Value = NDArray[Any] | np.float64
DEEPEST = 100
"""How deep expressions may be nested, including those of their variables."""
LARGEST = 1e9

_ARITHMETIC: Mapping[type, Callable[..., Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Mod: np.mod,
    ast.Pow: np.power, ast.USub: np.negative, ast.UAdd: np.positive, ast.Not: np.logical_not,
    ast.Invert: np.logical_not, ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater,
    ast.GtE: np.greater_equal, ast.Eq: np.isclose, ast.BitAnd: np.logical_and, ast.BitOr: np.logical_or,
    ast.And: np.logical_and, ast.Or: np.logical_or,
}  # fmt: skip
# Numpy's own functions would take further arguments, such as arrays to write into.
FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": lambda a: np.abs(a),
    "sqrt": lambda a: np.sqrt(np.maximum(a, 0.0)),
    "exp": lambda a: np.exp(np.minimum(a, 50.0)),
    "min": lambda a, b: np.minimum(a, b),
    "max": lambda a, b: np.maximum(a, b),
    "where": lambda c, a, b: np.where(c, a, b),
    "clip": lambda a, low, high: np.clip(a, low, high),
}


class Vocabulary(Protocol):
    """An expression's names beyond arithmetic; its methods raise :class:`ValueError` with a reason."""

    @property
    def words(self) -> str:
        """A description for messages: "x, y, z and the objects' names"."""
        ...

    @property
    def variables(self) -> Mapping[str, ast.expr]:
        """Names that stand for expressions."""
        ...

    def array(self, name: str) -> Value | None:
        """The value of a name, None if it is unknown."""
        ...

    def attribute(self, owner: ast.expr, name: str) -> Value:
        """The value of ``owner.name``."""
        ...

    def function(
        self, name: str
    ) -> Callable[[Sequence[ast.expr], Callable[[ast.expr], Value]], Value] | None:
        """A function of the arguments' nodes and of their evaluator; None if there is none."""
        ...


class Interpreter:
    """Evaluates expressions over one set of arrays; each variable is evaluated once."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._vocabulary = vocabulary
        self._known: dict[str, Value] = {}

    def value(self, node: ast.expr) -> Value:
        """The finite value of an expression; raises :class:`ValueError` that says what is wrong with it."""
        with np.errstate(all="ignore"):
            found = np.asarray(self._value(node, 0), dtype=np.float64)
        if not np.isfinite(found).all():
            raise ValueError(f"'{_shown(node)}' is not finite everywhere; do not divide by what may be 0.")
        return found

    def _value(self, node: ast.expr, depth: int) -> Value:
        def value(inner: ast.expr) -> Value:
            return self._value(inner, depth + 1)

        if depth > DEEPEST:
            raise ValueError("The expressions are nested too deeply, or a variable uses itself.")
        match node:
            case ast.Constant(value=bool() | int() | float() as number) if abs(number) < LARGEST:
                return np.float64(number)
            case ast.Name(id=name) if (found := self._named(name, value)) is not None:
                return found
            case ast.Attribute(value=owner, attr=name):
                return self._vocabulary.attribute(owner, name)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return _combined(op, value(left), value(right))
            case ast.UnaryOp(op=op, operand=operand):
                return _combined(op, value(operand))
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _ARITHMETIC:
                return _combined(op, value(left), value(right))
            case ast.BoolOp(op=op, values=[first, *rest]):
                found = value(first)
                for each in rest:
                    found = _combined(op, found, value(each))
                return found
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._called(name, args, value)
        words = f"{self._vocabulary.words}, {', '.join(FUNCTIONS)} and arithmetic"
        raise ValueError(f"'{_shown(node)}' is not allowed here; use {words}.")

    def _named(self, name: str, value: Callable[[ast.expr], Value]) -> Value | None:
        if name not in self._known:
            if name not in self._vocabulary.variables:
                return self._vocabulary.array(name)
            self._known[name] = value(self._vocabulary.variables[name])
        return self._known[name]

    def _called(self, name: str, args: Sequence[ast.expr], value: Callable[[ast.expr], Value]) -> Value:
        own = self._vocabulary.function(name)
        try:
            if own is not None:
                return own(args, value)
            if name in FUNCTIONS:
                return np.asarray(FUNCTIONS[name](*map(value, args)))
        except (TypeError, IndexError):
            raise ValueError(f"{name}() does not take these {len(args)} arguments.") from None
        raise ValueError(f"There is no {name}(); there are {self._vocabulary.words}, {', '.join(FUNCTIONS)}.")


def _combined(op: ast.AST, *values: Value) -> Value:
    try:
        return np.asarray(_ARITHMETIC[type(op)](*values))
    except TypeError:  # the sign of a condition: numpy has none
        return np.asarray(_ARITHMETIC[type(op)](*(np.asarray(v, dtype=np.float64) for v in values)))


def _shown(node: ast.expr) -> str:
    text = ast.unparse(node)
    return text if len(text) <= 80 else f"{text[:80]}..."
