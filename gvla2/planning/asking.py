"""Calls of untrusted perceivers and planners, within a time limit: their answers are well-formed or refused."""

from __future__ import annotations

import ctypes
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass, replace
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from gvla2.errors import ConformanceError, PerceptionError, PlannerTimeoutError, PlanningError
from gvla2.geometry.exchange import read_only, require, require_array, require_rigid, require_type
from gvla2.geometry.views import Observation
from gvla2.planning.contracts import Perceiver, Plan, Planner, PlanRequest
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import MAX_WAYPOINTS, Trajectory

ABSURD = 10 * MAX_WAYPOINTS
"""Longer trajectories are not checked waypoint by waypoint; up to here the checks report what is too many."""

T = TypeVar("T")


def perceive(
    perceiver: Perceiver, observation: Observation, instruction: str, workspace: Box, who: str
) -> Scene:
    """The perceiver's scene; its arrays are read-only, as are the ones that it is given.

    Raises :class:`PerceptionError` when nothing is seen, and for an answer of ``who``, the perceiver, that is no scene.
    """
    scene = perceiver.perceive(read_only(observation), instruction, read_only(workspace))
    try:
        check_scene(scene)
    except (ConformanceError, TypeError, ValueError) as error:
        raise PerceptionError(f"{who} gave no valid scene. {error}") from error
    return read_only(replace(scene, viewpoint=observation.viewpoint))


def check_scene(scene: object) -> None:
    """Whether this is a scene whose objects have unique ids, rigid poses and finite sizes and points.

    Raises :class:`ConformanceError` with the first violation.
    """
    require_type(scene, Scene, "perceive()'s answer")
    assert isinstance(scene, Scene)
    require_type(scene.objects, tuple, "The scene's objects")
    height: object = scene.table_height
    require(_finite(height), f"table_height must be finite, got {height!r:.80}.")
    for obj in scene.objects:
        require_type(obj, SceneObject, "An object of the scene")
        what = f"Object '{obj.id}'"
        require_rigid(obj.world_from_object, f"{what}: world_from_object")
        extents = require_array(obj.extents, (3,), f"{what}: extents")
        require((extents >= 0).all(), f"{what}: extents must not be negative, got {extents.tolist()}.")
        require_array(obj.points, (None, 3), f"{what}: points")
    ids = [obj.id for obj in scene.objects]
    require(all(ids) and len(set(ids)) == len(ids), f"Ids of objects must be unique, got {ids}.")


def ask(planner: Planner, request: PlanRequest, name: str, seconds: float = 0.0) -> Plan:
    """The planner's plan, with valid types, finite numbers and a checkable number of waypoints.

    Raises :class:`PlannerTimeoutError` when ``name`` does not answer within ``seconds`` (0 waits for ever), and
    :class:`PlanningError` for an answer that is not a plan. The checks decide whether the plan is good.
    """
    plan = _within(seconds, lambda: planner.plan(request), name)
    if problem := fault_of_plan(plan):
        raise PlanningError(f"The planner '{name}' returned {problem}.")
    return plan


def fault_of_plan(plan: object) -> str:
    """What is wrong with an answer, worded to follow "returned"; "" if nothing."""
    if not isinstance(plan, Plan):
        return f"{type(plan).__name__}, not a Plan"
    if plan.trajectory is None and plan.abstention is None:
        return "neither a trajectory nor an abstention with its reason"
    count = len(plan.trajectory.waypoints) if isinstance(plan.trajectory, Trajectory) else 1
    if not 0 < count <= ABSURD:
        return f"a trajectory of {count} waypoints; give 1 to {MAX_WAYPOINTS}, or the reason in an abstention"
    problem = _misfit(plan, Plan, "")
    return f"a plan with {problem}" if problem else ""


def _misfit(value: Any, kind: Any, name: str) -> str:
    """Why a value is not of an annotated type, "NAME VALUE, which is not KIND"; "" if it is.

    Numbers must be finite; a list passes for a tuple.
    """
    origin, args = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        faults = [_misfit(value, one, name) for one in args]
        deeper = (fault for fault in faults if not fault.startswith(f"{name} "))
        return "" if "" in faults else next(deeper, faults[0])
    if kind is Any:
        return ""
    if kind in (float, int):
        fits = _finite(value)
    elif origin is Literal:
        fits = isinstance(value, str) and value in args
    elif origin is tuple:
        fits = isinstance(value, tuple | list) and (args[-1] is ... or len(value) == len(args))
    else:
        fits = isinstance(value, origin or kind)
    if not fits:
        named = (
            f"one of {', '.join(map(str, args))}" if origin is Literal else kind if args else kind.__name__
        )
        wanted = "a finite number" if kind in (float, int) else named
        return f"{name} {value!r:.100}, which is not {wanted}"
    return next(filter(None, (_misfit(*each) for each in _contents(value, kind, name))), "")


def _contents(value: Any, kind: Any, name: str) -> Iterator[tuple[Any, Any, str]]:
    """What a value of a type contains: values, their types and names."""
    args = get_args(kind)
    if is_dataclass(kind):
        for field, hint in get_type_hints(kind).items():
            yield getattr(value, field), hint, f"{name}.{field}".lstrip(".")
    elif isinstance(value, Mapping) and args:
        for key, item in value.items():
            yield key, args[0], f"a key of {name}"
            yield item, args[1], f"{name}[{key!r:.40}]"
    elif isinstance(value, tuple | list | frozenset) and args:
        kinds = args if args[-1] is not ... and len(args) == len(value) else args[:1] * len(value)
        for number, (item, own) in enumerate(zip(value, kinds, strict=True)):
            yield item, own, f"{name}[{number}]"


def _finite(value: object) -> bool:
    """Whether it is a finite number: NumPy's scalars count, True does not."""
    if isinstance(value, bool) or not hasattr(value, "__float__") or getattr(value, "shape", ()) != ():
        return False
    return math.isfinite(float(value))


def _within(seconds: float, function: Callable[[], T], name: str) -> T:
    """The result of ``function``; raises :class:`PlannerTimeoutError` when it takes longer. 0 waits for ever.

    With a limit, the function runs in a thread of its own; when the limit is reached, that thread is abandoned, and
    interrupted as soon as it executes Python code.
    """
    if seconds <= 0:
        return function()
    answer: list[T] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            answer.append(function())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run, name="gvla2-deadline", daemon=True)
    thread.start()
    thread.join(seconds)
    if failed:
        raise failed[0]
    if answer:
        return answer[0]
    ident, exit_ = ctypes.c_ulong(thread.ident or 0), ctypes.py_object(SystemExit)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ident, exit_)
    raise PlannerTimeoutError(
        f"The planner '{name}' gave no answer within {seconds:g} s; planner_timeout=SECONDS waits longer."
    )
