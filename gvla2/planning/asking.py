"""Calls of untrusted perceivers and planners, within a time limit: their answers are well-formed or refused."""

from __future__ import annotations

import ctypes
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar, get_args

from gvla2.errors import ConformanceError, Gvla2Error, PerceptionError, PlannerTimeoutError, PlanningError
from gvla2.geometry.exchange import read_only, require, require_array, require_rigid, require_type
from gvla2.geometry.views import Observation
from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import (
    Abstention,
    AbstentionKind,
    Candidate,
    Perceiver,
    Plan,
    Planner,
    PlanRequest,
)
from gvla2.planning.effects import SIDES
from gvla2.planning.programs import Program
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import MAX_WAYPOINTS, Guard, Orientation, Trajectory, Waypoint

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
    try:
        plan = within(seconds, lambda: planner.plan(request))
    except DeadlineError:
        raise PlannerTimeoutError(
            f"The planner '{name}' gave no answer within {seconds:g} s; planner_timeout=SECONDS waits longer."
        ) from None
    if problem := fault_of_plan(plan):
        raise PlanningError(f"The planner '{name}' returned {problem}.")
    return plan


def fault_of_plan(plan: object) -> str:
    """What is wrong with an answer, worded to follow "returned"; "" if nothing."""
    if not isinstance(plan, Plan):
        return f"{type(plan).__name__}, not a Plan"
    if problem := _misfit(plan, _PLAN):
        return f"a plan with {problem}"
    trajectory: object = plan.trajectory
    if plan.abstention is not None:
        kinds = get_args(AbstentionKind)
        known = plan.abstention.kind in kinds
        kind = f"{plan.abstention.kind!r:.40}; kinds are {', '.join(kinds)}"
        return "" if known else f"an abstention of kind {kind}"
    if trajectory is None:
        return "neither a trajectory nor an abstention with its reason"
    if not isinstance(trajectory, Trajectory):
        return f"a trajectory that is {type(trajectory).__name__}, not Trajectory(waypoints)"
    if not _tuple_of(Waypoint)(trajectory.waypoints):
        return "a trajectory that is not a tuple of waypoints"
    if not trajectory.waypoints:
        return "a trajectory without waypoints; give the reason in an abstention"
    if len(trajectory) > ABSURD:
        return f"a trajectory of {len(trajectory)} waypoints; at most {MAX_WAYPOINTS} can be executed"
    for index, waypoint in enumerate(trajectory):
        if problem := _misfit(waypoint, _WAYPOINT):
            return f"waypoint {index} ('{waypoint.stage!s:.40}') with {problem}"
    return ""


Fits = Callable[[Any], bool]


def _misfit(answer: object, table: Mapping[str, tuple[Fits, str]]) -> str:
    """The first field that fails its test, and what it should be; "" if there is none."""
    for name, (fits, wanted) in table.items():
        value = getattr(answer, name)
        if not fits(value):
            return f"{name} {value!r:.100}, which is not {wanted}"
    return ""


def _text(value: object) -> bool:
    return isinstance(value, str)


def _finite(value: object) -> bool:
    """Whether it is a finite number: NumPy's scalars count, True does not."""
    if isinstance(value, bool) or not hasattr(value, "__float__") or getattr(value, "shape", ()) != ():
        return False
    return math.isfinite(float(value))


def _three(value: object) -> bool:
    """Whether it is a triple of numbers, not an array: waypoints are compared, which arrays do not support."""
    return isinstance(value, tuple | list) and len(value) == 3 and all(map(_finite, value))


def _mapping(values: Fits) -> Fits:
    return lambda given: (
        isinstance(given, Mapping) and all(map(_text, given)) and all(map(values, given.values()))
    )


def _tuple_of(kind: type) -> Fits:
    return lambda values: isinstance(values, tuple) and all(isinstance(value, kind) for value in values)


def _scale(value: object) -> bool:
    """Whether it is a :data:`~gvla2.planning.effects.Scale`."""
    if not isinstance(value, tuple) or len(value) != 2 or value[0] not in SIDES:
        return False
    return _finite(value[1]) and value[1] > 0.0


def _oriented(value: object) -> bool:
    return isinstance(value, Orientation) and _three(value.vector) and _three(value.closing)


def _guard(value: object) -> bool:
    return value is None or (isinstance(value, Guard) and _finite(value.force) and _finite(value.stall))


_PLAN: Mapping[str, tuple[Fits, str]] = {
    "skill": (_text, "text"),
    "notes": (_tuple_of(str), "a tuple of texts"),
    "roles": (_mapping(_text), "a mapping from text to text"),
    "parameters": (_mapping(_finite), "a mapping from names to finite numbers"),
    "scales": (_mapping(_scale), "a mapping from names to a side and its length"),
    "candidates": (_tuple_of(Candidate), "a tuple of Candidate"),
    "calls": (_tuple_of(SkillCall), "a tuple of SkillCall"),
    "remaining": (_tuple_of(SkillCall), "a tuple of SkillCall"),
    "program": (lambda value: isinstance(value, Program | None), "a Program or None"),
    "transcript": (_tuple_of(Mapping), "a tuple of mappings"),
    "abstention": (lambda value: isinstance(value, Abstention | None), "an Abstention or None"),
}
"""What the fields of a plan must be, and how to say it; the trajectory comes after."""

_WAYPOINT: Mapping[str, tuple[Fits, str]] = {
    **dict.fromkeys(("stage", "motion", "carries"), (_text, "text")),
    **dict.fromkeys(("gripper", "speed", "tolerance", "dwell"), (_finite, "a finite number")),
    "xyz": (_three, "a tuple of three finite numbers"),
    "allowed_contacts": (
        lambda ids: isinstance(ids, frozenset) and all(map(_text, ids)),
        "a frozenset of ids",
    ),
    "orientation": (_oriented, "an Orientation of finite numbers"),
    "guard": (_guard, "a Guard of finite numbers or None"),
}


class DeadlineError(Gvla2Error):
    """The time limit was reached before an answer."""


def within(seconds: float, function: Callable[[], T]) -> T:
    """The result of ``function``; raises :class:`DeadlineError` when it takes longer. 0 waits for ever.

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
    if not answer:
        ctypes.pythonapi.PyThreadState_SetAsyncExc(
            ctypes.c_ulong(thread.ident or 0), ctypes.py_object(SystemExit)
        )
        raise DeadlineError(f"There was no answer within {seconds:g} s.")
    return answer[0]
