"""Value maps: a program of moves, ``move("grasp", affordance=at(ball), gripper=0)``, and the values of its maps.

Maps are expressions, parsed and interpreted node by node, never run. Numbers, arithmetic, comparisons, logic and a few
functions mean the same as in Python and numpy. ``x``, ``y``, ``z`` are millimetres as in the scene's brief, whose names
denote objects. Anything else is refused with a reason.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from functools import partial, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene, SceneObject

Value = NDArray[Any] | np.float64
Move = Mapping[str, ast.expr]
"""The expressions of a move's maps by name."""

_ARITHMETIC: Mapping[type, Callable[..., Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Mod: np.mod,
    ast.Pow: np.power, ast.USub: np.negative, ast.UAdd: np.positive, ast.Not: np.logical_not,
    ast.Invert: np.logical_not, ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater,
    ast.GtE: np.greater_equal, ast.Eq: np.isclose, ast.BitAnd: np.logical_and, ast.BitOr: np.logical_or,
    ast.And: np.logical_and, ast.Or: np.logical_or,
}  # fmt: skip
LARGEST = 1e9
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

MAPS = ("affordance", "avoidance", "gripper")
LONGEST, MOST_NODES, MOST_STAGES = 4000, 600, 10
"""Characters, nodes of its tree, and moves of a program: these bound its time and memory."""


def read_program(text: str) -> list[Move]:
    """The moves in an answer, in order; raises :class:`ValueError` on what is wrong with it."""
    source = text.split("```")[1].removeprefix("python").strip() if text.count("```") >= 2 else text.strip()
    if len(source) > LONGEST:
        raise ValueError(f"The program has {len(source)} characters; write at most {LONGEST}.")
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ValueError(f"It cannot be read ({error}); write lines move(...) and nothing else.") from None
    if sum(1 for _ in ast.walk(tree)) > MOST_NODES:
        raise ValueError("The program is too long; write fewer and simpler moves.")
    moves: list[Move] = []
    for line in tree.body:
        match line:
            case ast.Expr(value=ast.Call(func=ast.Name(id="move"), args=args, keywords=keywords)):
                maps = {str(k.arg): k.value for k in keywords}
                if len(args) > 1 or set(maps) - set(MAPS) or "affordance" not in maps:
                    has = f"a name, an affordance, and of {', '.join(MAPS)}"
                    raise ValueError(f"Line {line.lineno}: a move has {has}.")
                moves.append(maps)
            case _:
                raise ValueError(f"Line {line.lineno} is not move(...).")
    if not 1 <= len(moves) <= MOST_STAGES:
        raise ValueError(f"It has {len(moves)} moves; write 1 to {MOST_STAGES}.")
    return moves


class MapInterpreter:
    """Evaluates maps at points (..., 3), world metres."""

    def __init__(self, scene: Scene, ids: Mapping[str, str], points: FloatArray) -> None:
        self._scene, self._ids, self._points = scene, ids, points

    def values(self, map_: ast.expr) -> FloatArray:
        """(...) finite values of a map at the points; raises :class:`ValueError` that says what is wrong with it."""
        with np.errstate(all="ignore"):
            found = np.asarray(self._value(map_), dtype=np.float64)
        if not np.isfinite(found).all():
            raise ValueError(
                f"'{ast.unparse(map_)[:80]}' is not finite everywhere; do not divide by what may be 0."
            )
        return np.broadcast_to(found, self._points.shape[:-1])

    def _value(self, node: ast.expr) -> Value:
        match node:
            case ast.Constant(value=bool() | int() | float() as number) if abs(number) < LARGEST:
                return np.float64(number)
            case ast.Name(id="x" | "y" | "z" as axis):  # millimetres, z above the table
                lowest = self._scene.table_height if axis == "z" else 0.0
                return np.asarray(1e3 * (self._points[..., "xyz".index(axis)] - lowest))
            case ast.Attribute(value=owner, attr=name):
                return self._attribute(owner, name)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return _combined(op, self._value(left), self._value(right))
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _ARITHMETIC:
                return _combined(op, self._value(left), self._value(right))
            case ast.UnaryOp(op=op, operand=operand):
                return _combined(op, self._value(operand))
            case ast.BoolOp(op=op, values=values):
                return reduce(partial(_combined, op), map(self._value, values))
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._called(name, args)
        raise ValueError(f"'{ast.unparse(node)[:80]}' is not allowed here; use {WORDS} and arithmetic.")

    def _called(self, name: str, args: Sequence[ast.expr]) -> Value:
        try:
            if name in _PLACES:
                lengths = [float(self._value(a)) for a in args[1:]]
                if wrong := next((length for length in lengths if 0.0 < abs(length) < 1.0), 0.0):
                    raise ValueError(f"A length is {wrong:g}; lengths are millimetres: 0.1 m is 100.")
                return _PLACES[name](self._points, self._object(args[0]), *(1e-3 * v for v in lengths))
            if name in FUNCTIONS:
                return np.asarray(FUNCTIONS[name](*map(self._value, args)))
        except (TypeError, IndexError):
            raise ValueError(f"{name}() does not take these {len(args)} arguments.") from None
        raise ValueError(f"There is no {name}(); there are {WORDS}.")

    def _attribute(self, owner: ast.expr, name: str) -> Value:
        """A number of an object, millimetres."""
        obj, table = self._object(owner), self._scene.table_height
        x, y, z = obj.centre
        width, length = sorted(obj.extents[:2])
        sides = {"x": x, "y": y, "z": z - table, "top": obj.top - table, "bottom": obj.bottom - table,
                 "height": obj.top - obj.bottom, "width": width, "length": length}  # fmt: skip
        if name not in sides:
            raise ValueError(f"Objects have no '{name}'; they have {', '.join(sides)}.")
        return np.float64(1e3 * sides[name])

    def _object(self, node: ast.expr) -> SceneObject:
        name = node.id if isinstance(node, ast.Name) else node.value if isinstance(node, ast.Constant) else ""
        if not isinstance(name, str) or name not in self._ids:
            said = ast.unparse(node)[:60]
            raise ValueError(f"There is no object '{said}'; there are {', '.join(self._ids)}.")
        return self._scene[self._ids[name]]


def _combined(op: ast.AST, *values: Value) -> Value:
    # As floats: numpy has no sign of a condition.
    return np.asarray(_ARITHMETIC[type(op)](*(np.asarray(v, dtype=np.float64) for v in values)))


def _to(points: FloatArray, place: FloatArray) -> FloatArray:
    return np.asarray(-1e3 * np.linalg.norm(points - place, axis=-1))


_PLACES: Mapping[str, Callable[..., Value]] = {
    "at": lambda p, o: _to(p, o.centre),
    "above": lambda p, o, up=0.1: _to(p, np.array([*o.centre[:2], o.top + up])),
    "beside": lambda p, o, dx, dy, dz=0.0: _to(p, o.centre + np.array([dx, dy, dz])),
    "near": lambda p, o, reach=0.1: np.clip(1.0 - o.distances(p) / max(reach, 1e-3), 0.0, 1.0),
    "distance": lambda p, o: 1e3 * o.distances(p),
}
WORDS = f"x, y, z, the objects' names, {', '.join([*_PLACES, *FUNCTIONS])}"
"""The vocabulary of maps, for messages."""
