"""Value maps: a small language of array expressions over a voxel grid. Parsed and interpreted, never run as Python.

    move("grasp", affordance=at(ball), gripper=0)
    move("over the bowl", affordance=above(bowl, 120), avoidance=near(lamp, 80), speed=0.5)

``x``, ``y``, ``z`` are arrays, millimetres as in the scene's brief; names of objects stand for objects.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.scene import Scene, SceneObject

MAPS = ("affordance", "avoidance", "rotation", "gripper", "speed")
LONGEST, MOST_NODES, MOST_VARIABLES, MOST_STAGES = 4000, 600, 30, 10
"""Characters, nodes of its tree, variables and moves of a program: what bounds its time and memory."""
DEEPEST = 100
"""How deep its expressions may be nested."""

_ARITHMETIC: Mapping[type, Callable[..., FloatArray]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Mod: np.mod,
    ast.USub: np.negative, ast.UAdd: np.positive, ast.Not: np.logical_not, ast.Invert: np.logical_not,
    ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater, ast.GtE: np.greater_equal, ast.Eq: np.isclose,
    ast.BitAnd: np.logical_and, ast.BitOr: np.logical_or, ast.And: np.logical_and, ast.Or: np.logical_or,
    ast.Pow: np.power,
}  # fmt: skip
# Numpy's own functions would take further arguments, such as arrays to write into.
_FUNCTIONS: Mapping[str, Callable[..., FloatArray]] = {
    "abs": lambda a: np.abs(a),
    "sqrt": lambda a: np.sqrt(np.maximum(a, 0.0)),
    "exp": lambda a: np.exp(np.minimum(a, 50.0)),
    "min": lambda a, b: np.minimum(a, b),
    "max": lambda a, b: np.maximum(a, b),
    "where": lambda c, a, b: np.where(c, a, b),
    "clip": lambda a, low, high: np.clip(a, low, high),
}


@dataclass(frozen=True)
class Stage:
    """One move: its name and the expressions of its maps, by map."""

    name: str
    maps: Mapping[str, ast.expr]


@dataclass(frozen=True)
class Program:
    """The moves in their order, and the variables that their maps use."""

    stages: tuple[Stage, ...]
    variables: Mapping[str, ast.expr] = field(default_factory=dict)


def read_program(text: str) -> Program:
    """The program in an answer; raises :class:`ValueError` that says which line is none."""
    source = text.split("```")[1].removeprefix("python").strip() if text.count("```") >= 2 else text.strip()
    if len(source) > LONGEST:
        raise ValueError(f"The program has {len(source)} characters; write at most {LONGEST}.")
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ValueError(
            f"The program cannot be read ({error}); write lines move(...) and nothing else."
        ) from None
    if sum(1 for _ in ast.walk(tree)) > MOST_NODES:
        raise ValueError("The program is too long; write fewer and simpler moves.")
    stages: list[Stage] = []
    variables: dict[str, ast.expr] = {}
    for line in tree.body:
        match line:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                if name in variables or name in "xyz":
                    raise ValueError(f"'{name}' has a meaning already; use another name.")
                variables[name] = value
            case ast.Expr(value=ast.Call(func=ast.Name(id="move"), args=args, keywords=keywords)):
                stages.append(_stage(args, keywords, len(stages) + 1))
            case ast.Expr(value=ast.Constant(value=str())):
                continue  # prose
            case _:
                raise ValueError(f"Line {line.lineno} is neither move(...) nor name = expression.")
    if len(variables) > MOST_VARIABLES:
        raise ValueError(f"The program has {len(variables)} variables; use at most {MOST_VARIABLES}.")
    if not 1 <= len(stages) <= MOST_STAGES:
        raise ValueError(f"The program has {len(stages)} moves; write 1 to {MOST_STAGES}.")
    return Program(tuple(stages), variables)


def _stage(args: list[ast.expr], keywords: list[ast.keyword], number: int) -> Stage:
    name = args[0].value if args and isinstance(args[0], ast.Constant) else f"move {number}"
    maps = {str(k.arg): k.value for k in keywords}
    if len(args) > 1 or (strange := set(maps) - set(MAPS)) or "affordance" not in maps:
        what = f"it has no {sorted(strange)[0]}" if len(args) <= 1 and strange else "it needs an affordance"
        raise ValueError(f"Move {number}: {what}; a move has a name and {', '.join(MAPS)}, by their names.")
    return Stage(" ".join(str(name).split())[:40] or f"move {number}", maps)


class Field:
    """Evaluates a program's expressions at world points (..., 3), metres."""

    def __init__(self, scene: Scene, ids: Mapping[str, str], program: Program) -> None:
        self._scene, self._ids, self._variables = scene, ids, program.variables
        self._points: FloatArray | None = None
        self._known: dict[str, FloatArray] = {}

    def at(self, map_: ast.expr, points: FloatArray) -> FloatArray:
        """(...) values of a map; raises :class:`ValueError` for what is not of the language or not finite."""
        if points is not self._points:  # a variable is worked out once, however often it is used
            self._points, self._known = points, {}
        with np.errstate(all="ignore"):
            value = np.asarray(self._value(map_, points, 0), dtype=np.float64)
        if not np.isfinite(value).all():
            raise ValueError(
                f"'{ast.unparse(map_)[:80]}' is not finite everywhere; do not divide by what may be 0."
            )
        return np.broadcast_to(value, points.shape[:-1])

    def _value(self, node: ast.expr, points: FloatArray, depth: int) -> FloatArray:
        def value(inner: ast.expr) -> FloatArray:
            return self._value(inner, points, depth + 1)

        if depth > DEEPEST:
            raise ValueError("The expressions are nested too deeply, or a variable uses itself.")
        match node:
            case ast.Constant(value=bool() | int() | float() as number) if abs(number) < 1e9:
                return np.float64(number)
            case ast.Name(id="x" | "y" | "z" as axis):
                low = (0.0, 0.0, self._scene.table_height)["xyz".index(axis)]
                return 1e3 * (points[..., "xyz".index(axis)] - low)
            case ast.Name(id=name) if name in self._variables:
                if name not in self._known:
                    self._known[name] = value(self._variables[name])
                return self._known[name]
            case ast.Attribute(value=owner, attr=side):
                return np.float64(self._measure(self._thing(owner), side))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return _ARITHMETIC[type(op)](value(left), value(right))
            case ast.UnaryOp(op=op, operand=operand):
                return _ARITHMETIC[type(op)](value(operand))
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _ARITHMETIC:
                return _ARITHMETIC[type(op)](value(left), value(right))
            case ast.BoolOp(op=op, values=[first, *rest]):
                found = value(first)
                for each in rest:
                    found = _ARITHMETIC[type(op)](found, value(each))
                return found
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._call(name, args, points, value)
        raise ValueError(f"'{ast.unparse(node)[:60]}' is not of this language; there are {_VOCABULARY}.")

    def _call(
        self, name: str, args: list[ast.expr], points: FloatArray, value: Callable[[ast.expr], FloatArray]
    ) -> FloatArray:
        try:
            if name in _FUNCTIONS:
                return _FUNCTIONS[name](*map(value, args))
            if name not in _PLACES:
                raise ValueError(f"There is no {name}(); there are {_VOCABULARY}.")
            thing, numbers = self._thing(args[0]), [1e-3 * float(value(a)) for a in args[1:]]
            return _PLACES[name](points, thing, *numbers)
        except (TypeError, IndexError):
            raise ValueError(
                f"{name}() cannot be asked for with {len(args)} arguments such as these."
            ) from None

    def _thing(self, node: ast.expr) -> SceneObject:
        name = node.id if isinstance(node, ast.Name) else node.value if isinstance(node, ast.Constant) else ""
        if name not in self._ids:
            raise ValueError(
                f"There is no object '{ast.unparse(node)[:60]}'; there are {', '.join(self._ids)}."
            )
        return self._scene[self._ids[name]]

    def _measure(self, thing: SceneObject, side: str) -> float:
        x, y, z = thing.centre
        low, high = thing.bottom, thing.top
        table, level = self._scene.table_height, sorted(thing.extents[:2])
        sides = {"x": x, "y": y, "z": z - table, "top": high - table, "bottom": low - table, "height": high - low,
                 "width": level[0], "length": level[1]}  # fmt: skip
        if side not in sides:
            raise ValueError(f"Objects have no '{side}'; they have {', '.join(sides)}.")
        return 1e3 * float(sides[side])


def _distance(points: FloatArray, thing: SceneObject) -> FloatArray:
    local = np.abs(transform_points(invert_rigid(thing.world_from_object), points)) - 0.5 * thing.extents
    return 1e3 * np.linalg.norm(np.maximum(local, 0.0), axis=-1)


def _to(points: FloatArray, place: FloatArray) -> FloatArray:
    return -1e3 * np.linalg.norm(points - place, axis=-1)


def _top(thing: SceneObject, up: float) -> FloatArray:
    return np.array([*thing.centre[:2], thing.top + up])


_PLACES: Mapping[str, Callable[..., FloatArray]] = {
    "at": lambda p, o: _to(p, o.centre),
    "above": lambda p, o, up=0.1: _to(p, _top(o, up)),
    "beside": lambda p, o, dx, dy, dz=0.0: _to(p, o.centre + np.array([dx, dy, dz])),
    "distance": _distance,
    "near": lambda p, o, reach=0.1: np.clip(1.0 - _distance(p, o) / max(1e3 * reach, 1.0), 0.0, 1.0),
}
_VOCABULARY = f"x, y, z, the objects' names, {', '.join([*_PLACES, *_FUNCTIONS])} and arithmetic"
