"""The language of programs: a subset of Python's syntax, parsed and interpreted here; no Python is executed.

Statements: calls of skills, assignments, ``for`` over a list, ``if``/``elif``/``else``, ``pass``. Expressions: names
of things, numbers, strings, flat lists, ``not``/``and``/``or``, comparisons, ``in``, and the functions of
:data:`QUESTIONS` about things of the scene. Statements, calls and the size of every value are bounded.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gvla2.planning.calls import RELATIONS, WAYS, SkillCall
from gvla2.planning.contracts import AbstentionKind
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.skill import Skill

DECLINE = "decline"
"""The call by which a program refuses the wish, with a reason: ``decline(absent)``."""
WHY: Mapping[str, tuple[AbstentionKind, str]] = {
    "absent": ("nothing_matches", "What the wish is about is not there."),
    "unclear": ("ambiguous", "It is not clear which thing is meant."),
    "impossible": ("other", "No skill does what the wish asks for."),
}
"""Reasons to decline, each with the kind and message of an abstention."""
MOST_STEPS, MOST_CALLS, LONGEST = 400, 12, 4000
"""Most statements executed, calls made and characters of a program."""
LARGEST = 1e4
"""The largest number in a program, millimetres."""
_IN = re.compile(r"(?<=[,(=])\s*in(?=\s*[,)])")
"""The relation ``in``, a keyword of Python."""
_COMPARE: Mapping[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge, ast.In: lambda a, b: a in b, ast.NotIn: lambda a, b: a not in b,
}  # fmt: skip


class Declined(Exception):  # noqa: N818 - an answer, not an error
    """The program declines; ``reason`` is one of :data:`WHY`."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


@dataclass
class ProgramInterpreter:
    """Interprets one program for a scene. ``ids`` are the scene's ids by name; :meth:`run` returns its calls."""

    scene: Scene
    ids: Mapping[str, str]
    skills: Mapping[str, Skill]
    calls: list[SkillCall] = field(default_factory=list)
    variables: dict[str, Any] = field(default_factory=dict)
    steps: int = 0

    def run(self, text: str) -> tuple[SkillCall, ...]:
        """The program's calls. Raises :class:`ValueError` with a sentence for its author, and :class:`Declined` if the
        program declines.
        """
        source = _IN.sub("'in'", code_in(text))
        try:
            self._block(ast.parse(source).body)
        except (SyntaxError, MemoryError) as error:
            raise ValueError(f"It is not a program: {error}.") from None
        except RecursionError:
            raise ValueError("It is nested too deeply.") from None
        if not self.calls:
            raise ValueError("The program calls no skill.")
        return tuple(self.calls)

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            self.steps += 1
            if self.steps > MOST_STEPS:
                raise ValueError(f"The program takes more than {MOST_STEPS} steps.")
            match statement:
                case ast.Expr(value=ast.Constant(value=str())) | ast.Pass():
                    continue
                case ast.Expr(value=ast.Call() as call):
                    self._call(call)
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    self.variables[self._free(name)] = self._value(value)
                case ast.For(target=ast.Name(id=name), iter=iterable, body=body, orelse=[]):
                    things = self._value(iterable)
                    if not isinstance(things, list):
                        raise ValueError("A 'for' goes over a list.")
                    for thing in things:
                        self.variables[self._free(name)] = thing
                        self._block(body)
                case ast.If(test=test, body=body, orelse=orelse):
                    self._block(body if self._true(test) else orelse)
                case _:
                    raise ValueError(
                        f"'{ast.unparse(statement)[:80]}' cannot be used: call skills, assign, for, if."
                    )

    def _free(self, name: str) -> str:
        if name in self.ids or name in self.skills or name == "things":
            raise ValueError(f"'{name}' is a name already; take another for the variable.")
        return name

    def _call(self, call: ast.Call) -> None:
        name = call.func.id if isinstance(call.func, ast.Name) else ast.unparse(call.func)[:40]
        if name == DECLINE:
            why = self._value(call.args[0]) if call.args else ""
            raise Declined(why if isinstance(why, str) and why in WHY else "impossible")
        if name not in self.skills:
            raise ValueError(f"There is no skill '{name}'; there are {', '.join(self.skills)}.")
        given = [self._value(a) for a in call.args]
        named = {str(k.arg): self._value(k.value) for k in call.keywords}
        if len(self.calls) == MOST_CALLS:
            raise ValueError(f"The program makes more than {MOST_CALLS} calls.")
        self.calls.append(self._skill_call(name, given, named))

    def _skill_call(self, skill: str, given: list[Any], named: dict[str, Any]) -> SkillCall:
        fields: dict[str, Any] = {}
        things = [v for v in given if isinstance(v, str) and v in self.ids]
        for value in given:
            if isinstance(value, str) and value in self.ids:
                continue
            if value in RELATIONS and value:
                fields["relation"] = value
            elif isinstance(value, str) and value in WAYS:
                fields["direction"] = WAYS[value]
            elif _is_number(value):
                fields["amount"] = 1e-3 * value
            else:
                raise ValueError(
                    f"In {skill}(...) '{value}' is not among the objects: {', '.join(self.ids)}."
                )
        for key, value in named.items():
            word = value if isinstance(value, str) else ""
            if key in ("theme", "goal") and word in self.ids:
                things.append(word)
            elif key in ("relation", "how") and word in RELATIONS and word:
                fields["relation"] = word
            elif key == "direction" and word in WAYS:
                fields["direction"] = WAYS[word]
            elif key in ("amount", "by") and _is_number(value):
                fields["amount"] = 1e-3 * value
            else:
                raise ValueError(f"{skill}(...) does not take {key}={value!r}.")
        if not 1 <= len(things) <= 2:
            raise ValueError(
                f"{skill} takes one thing, and a goal where it leads somewhere; it got {len(things)}."
            )
        if len(things) == 2 and self.skills[skill].role("goal") is None:
            raise ValueError(f"{skill} takes one thing and no goal.")
        theme, goal = self.ids[things[0]], self.ids[things[1]] if len(things) == 2 else ""
        return SkillCall(skill, theme, goal, **fields)

    def _value(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=bool() | str() as value):
                return value
            case ast.Constant(value=int() | float() as value):
                if not abs(value) <= LARGEST:
                    raise ValueError(f"A number is larger than {LARGEST:g}.")
                return float(value)
            case ast.Name(id=name):
                if name in self.variables:
                    return self.variables[name]
                if name == "things":
                    return list(self.ids)
                return name
            case ast.List(elts=elements) | ast.Tuple(elts=elements):
                found = [self._value(e) for e in elements]
                if any(isinstance(each, list) for each in found):
                    raise ValueError("A list holds names and numbers, no lists.")
                return found
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return not self._true(operand)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self._number(operand)
            case ast.BoolOp(op=op, values=values):
                truths = [self._true(v) for v in values]
                return all(truths) if isinstance(op, ast.And) else any(truths)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARE:
                return self._compared(op, self._value(left), self._value(right))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in QUESTIONS:
                takes, answer = QUESTIONS[name]
                if len(arguments) != takes:
                    raise ValueError(f"{name}(...) asks about {takes} thing{'s' * (takes > 1)}.")
                return answer(*(self._thing(a) for a in arguments))
        raise ValueError(f"'{ast.unparse(node)[:80]}' cannot be used in a program.")

    def _compared(self, op: ast.cmpop, left: Any, right: Any) -> bool:
        try:
            return bool(_COMPARE[type(op)](left, right))
        except TypeError:
            raise ValueError(f"'{left}' and '{right}' cannot be compared.") from None

    def _true(self, node: ast.expr) -> bool:
        """The value of a condition, which must be a bool: an unknown name would otherwise count as true."""
        value = self._value(node)
        if not isinstance(value, bool):
            raise ValueError(f"'{ast.unparse(node)[:80]}' is neither true nor false.")
        return value

    def _number(self, node: ast.expr) -> float:
        value = self._value(node)
        if not _is_number(value):
            raise ValueError(f"'{ast.unparse(node)[:80]}' is no number.")
        return float(value)

    def _thing(self, node: ast.expr) -> Any:
        name = self._value(node)
        if not isinstance(name, str) or name not in self.ids:
            raise ValueError(f"There is nothing called '{name}'; there are {', '.join(self.ids)}.")
        return self.scene[self.ids[name]]


def code_in(text: str) -> str:
    """The program in an answer: its code fence's content, else all of it. Raises :class:`ValueError` if too long."""
    if len(text) > LONGEST:
        raise ValueError(f"It has {len(text)} characters; {LONGEST} are enough for any program.")
    fenced = re.search(r"```(?:\w+)?\n(.*?)```", text, re.DOTALL)
    return (fenced.group(1) if fenced else text).strip()


def lines_of(text: str) -> list[str]:
    """The lines of a valid program without comments, in one canonical form, for memory."""
    tree = ast.parse(_IN.sub("'in'", code_in(text)))
    tree.body = [s for s in tree.body if not isinstance(s, ast.Expr) or isinstance(s.value, ast.Call)]
    return ast.unparse(tree).replace("'in'", "in").splitlines()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _inside(thing: SceneObject, other: SceneObject) -> bool:
    """Whether its middle is above the other's footprint."""
    return bool((abs(thing.centre[:2] - other.centre[:2]) < 0.5 * other.extents[:2]).all())


QUESTIONS: Mapping[str, tuple[int, Callable[..., Any]]] = {
    "height": (1, lambda thing: round(1e3 * (thing.top - thing.bottom))),
    "length": (1, lambda thing: round(1e3 * float(max(thing.extents[:2])))),
    "width": (1, lambda thing: round(1e3 * float(min(thing.extents[:2])))),
    "x": (1, lambda thing: round(1e3 * float(thing.centre[0]))),
    "y": (1, lambda thing: round(1e3 * float(thing.centre[1]))),
    "colour": (1, lambda thing: thing.colour),
    "is_on": (2, _inside),
}
"""Functions and their number of objects: millimetres, a colour word, or whether one is on or in the other."""
