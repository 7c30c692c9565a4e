"""Value maps: a program of moves, ``move("grasp", affordance=at(ball), gripper=0)``, and the values of its maps.

``x``, ``y``, ``z`` are millimetres as in the scene's brief, whose names denote objects.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene, SceneObject
from gvla2.programs.array_expressions import Interpreter, Value

MAPS = ("affordance", "avoidance", "rotation", "gripper", "speed")
LONGEST, MOST_NODES, MOST_VARIABLES, MOST_STAGES = 4000, 600, 30, 10
"""Characters, nodes of its tree, variables and moves of a program: these bound its time and memory."""
Evaluate = Callable[[ast.expr], Value]


class MapProgram(NamedTuple):
    """The expressions of each move's maps, in order, and the variables that they use."""

    stages: tuple[Mapping[str, ast.expr], ...]
    variables: Mapping[str, ast.expr]


def read_program(text: str) -> MapProgram:
    """The program in an answer; raises :class:`ValueError` on what is wrong with it."""
    source = text.split("```")[1].removeprefix("python").strip() if text.count("```") >= 2 else text.strip()
    if len(source) > LONGEST:
        raise ValueError(f"The program has {len(source)} characters; write at most {LONGEST}.")
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ValueError(f"It cannot be read ({error}); write lines move(...) and nothing else.") from None
    if sum(1 for _ in ast.walk(tree)) > MOST_NODES:
        raise ValueError("The program is too long; write fewer and simpler moves.")
    stages: list[Mapping[str, ast.expr]] = []
    variables: dict[str, ast.expr] = {}
    for line in tree.body:
        match line:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                if name in variables or name in "xyz":
                    raise ValueError(f"'{name}' has a meaning already; use another name.")
                variables[name] = value
            case ast.Expr(value=ast.Call(func=ast.Name(id="move"), args=args, keywords=keywords)):
                maps = {str(k.arg): k.value for k in keywords}
                if len(args) > 1 or set(maps) - set(MAPS) or "affordance" not in maps:
                    has = f"a name, an affordance, and of {', '.join(MAPS)}"
                    raise ValueError(f"Line {line.lineno}: a move has {has}.")
                stages.append(maps)
            case _:
                raise ValueError(f"Line {line.lineno} is neither move(...) nor name = expression.")
    if len(variables) > MOST_VARIABLES or not 1 <= len(stages) <= MOST_STAGES:
        has = f"{len(stages)} moves and {len(variables)} variables"
        raise ValueError(f"It has {has}; write 1 to {MOST_STAGES} and at most {MOST_VARIABLES}.")
    return MapProgram(tuple(stages), variables)


class MapVocabulary:
    """The names and functions of maps at points (..., 3), metres: a :class:`.array_expressions.Vocabulary`."""

    words = "x, y, z, the objects' names, at, above, beside, near, distance"

    def __init__(self, scene: Scene, ids: Mapping[str, str], program: MapProgram, points: FloatArray) -> None:
        self._scene, self._ids, self._points = scene, ids, points
        self.variables = program.variables
        self._interpreter = Interpreter(self)

    def values(self, map_: ast.expr) -> FloatArray:
        """(...) values of a map at the points; raises :class:`ValueError` for anything outside the language."""
        return np.broadcast_to(self._interpreter.value(map_), self._points.shape[:-1])

    def array(self, name: str) -> Value | None:
        """The coordinates, millimetres above the table."""
        if name not in ("x", "y", "z"):
            return None
        axis = "xyz".index(name)
        return np.asarray(1e3 * (self._points[..., axis] - (self._scene.table_height if axis == 2 else 0.0)))

    def attribute(self, owner: ast.expr, name: str) -> Value:
        """A number of an object, millimetres."""
        obj, table = self._object(owner), self._scene.table_height
        x, y, z = obj.centre
        width, length = sorted(obj.extents[:2])
        sides = {"x": x, "y": y, "z": z - table, "top": obj.top - table, "bottom": obj.bottom - table,
                 "height": obj.top - obj.bottom, "width": width, "length": length}  # fmt: skip
        if name not in sides:
            raise ValueError(f"Objects have no '{name}'; they have {', '.join(sides)}.")
        return np.float64(1e3 * sides[name])

    def function(self, name: str) -> Callable[[Sequence[ast.expr], Evaluate], Value] | None:
        """A map made of an object and of distances in millimetres."""
        return partial(self._place, _PLACES[name]) if name in _PLACES else None

    def _place(self, place: Callable[..., Value], args: Sequence[ast.expr], value: Evaluate) -> Value:
        lengths = [float(value(a)) for a in args[1:]]
        for length in lengths:
            if 0.0 < abs(length) < 1.0:
                raise ValueError(f"A length is {length:g}; lengths are millimetres: 0.1 m is 100.")
        return place(self._points, self._object(args[0]), *(1e-3 * v for v in lengths))

    def _object(self, node: ast.expr) -> SceneObject:
        name = node.id if isinstance(node, ast.Name) else node.value if isinstance(node, ast.Constant) else ""
        if not isinstance(name, str) or name not in self._ids:
            said = ast.unparse(node)[:60]
            raise ValueError(f"There is no object '{said}'; there are {', '.join(self._ids)}.")
        return self._scene[self._ids[name]]


def _to(points: FloatArray, place: FloatArray) -> FloatArray:
    return np.asarray(-1e3 * np.linalg.norm(points - place, axis=-1))


_PLACES: Mapping[str, Callable[..., Value]] = {
    "at": lambda p, o: _to(p, o.centre),
    "above": lambda p, o, up=0.1: _to(p, np.array([*o.centre[:2], o.top + up])),
    "beside": lambda p, o, dx, dy, dz=0.0: _to(p, o.centre + np.array([dx, dy, dz])),
    "near": lambda p, o, reach=0.1: np.clip(1.0 - o.distances(p) / max(reach, 1e-3), 0.0, 1.0),
    "distance": lambda p, o: 1e3 * o.distances(p),
}
