"""Conformance of perceivers, planners and skills."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from math import isfinite

import numpy as np

from gvla2.errors import PerceptionError
from gvla2.geometry.exchange import require, require_rigid, require_share, require_type
from gvla2.geometry.views import Observation, Views
from gvla2.language.contracts import LanguageModelError
from gvla2.planning.asking import check_scene, fault_of_plan
from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Abstention, Advice, Perceiver, Plan, Planner, PlanRequest
from gvla2.planning.effects import Ban, Bound, Prior
from gvla2.planning.scene import Scene
from gvla2.planning.skill import Job, Proposal, Skill, fault_of
from gvla2.planning.trajectory import MAX_WAYPOINTS, MIN_WAYPOINTS
from gvla2.skills.carry_out import carry_out
from gvla2.skills.table import STANDARD
from gvla2.testing import inputs
from gvla2.testing.conformance import allowed, require_members


def check_perceiver(perceiver: Perceiver, *, finds: bool = True) -> None:
    """Two cubes on a table, three cameras; then a table that cannot be seen.

    ``finds`` asks that an object is reported within 3 cm of each cube and the table within 2 cm; disable it for a
    perceiver that needs trained weights.
    """
    require_members(perceiver, "perceiver")
    scene = _perceived(perceiver, inputs.observation(), inputs.INSTRUCTION)
    if finds:
        require(scene is not None, "perceive() must not raise PerceptionError for two cubes on a table.")
    if finds and scene is not None:
        error = abs(scene.table_height - inputs.TABLE)
        require(error < 0.02, f"The table's height is off by {error:.3f} m.")
        for block in (inputs.RED, inputs.BLUE):
            centre = block.world_from_block[:3, 3]
            gap = min((float(np.linalg.norm(o.centre - centre)) for o in scene.objects), default=np.inf)
            require(
                gap < 0.03,
                f"No object lies within 3 cm of the {block.label}; the nearest is {gap:.3f} m off.",
            )
    seen = inputs.observation(48)
    blind = Views(tuple(replace(v, depth=np.full((48, 48), np.nan, dtype=np.float32)) for v in seen.views))
    _perceived(perceiver, replace(seen, views=blind), "")


def _perceived(perceiver: Perceiver, seen: Observation, instruction: str) -> Scene | None:
    """A valid scene, or None for a :class:`PerceptionError`, the one error that is allowed."""
    with allowed("perceive()", PerceptionError), suppress(PerceptionError):
        scene = perceiver.perceive(seen, instruction, inputs.WORKSPACE)
        _check_scene(scene)
        return scene
    return None


def _check_scene(scene: Scene) -> None:
    check_scene(scene)
    ids = {o.id for o in scene.objects}
    for obj in scene.objects:
        what = f"Object '{obj.id}'"
        require(obj.label, f"{what}: its label must not be empty.")
        require_share(obj.confidence, f"{what}: confidence")
        require(
            not obj.parent or obj.parent in ids,
            f"{what}: its parent '{obj.parent}' is not in the scene.",
        )


def check_planner(planner: Planner, request: PlanRequest | None = None) -> None:
    """A feasible request, infeasible ones, advice, and a second try after a rejection.

    ``request`` replaces the built-in one (two cubes on a table under a gantry), for a planner of other scenes. One with
    a language model may raise :class:`~gvla2.language.LanguageModelError` if that is unavailable.
    """
    require_members(planner, "planner")
    asked = request or inputs.plan_request()
    effects = (
        Bound("lift_height", 0.2, ">="),
        Prior("no_such_parameter", 1.0, count=3),
        Ban("approach:side"),
    )
    for what, variant in {
        "": asked,
        " for an empty instruction": replace(asked, instruction=""),
        " for words without meaning": replace(asked, instruction="flumber the grond wibbly"),
        " for an empty scene": replace(asked, scene=replace(asked.scene, objects=())),
        " with advice": replace(asked, advice=Advice("Lift higher.", effects)),
        " after a rejection": replace(asked, rejections=("waypoint 1 is out of reach",)),
    }.items():
        with allowed(f"plan(){what}", LanguageModelError):
            try:
                plan = planner.plan(variant)
            except LanguageModelError:
                continue  # its model is unavailable: not the planner's fault, and the loop has a fallback
        _check_plan(plan, variant, what)


def _check_plan(plan: Plan, request: PlanRequest, what: str) -> None:
    fault = fault_of_plan(plan)
    require(not fault, f"plan(){what} returned {fault}.")
    require(
        (plan.trajectory is None) == (plan.abstention is not None),
        f"plan(){what}: a plan has either a trajectory or an abstention, never both or neither.",
    )
    if plan.abstention is not None:
        require(plan.abstention.message, f"plan(){what}: an abstention needs a message.")
    ids = {o.id for o in request.scene.objects}
    for role, name in plan.roles.items():
        require(
            name in ids,
            f"plan(){what}: role '{role}' names '{name}', which is not in the scene {sorted(ids)}.",
        )
    if plan.trajectory is None:
        return
    count = len(plan.trajectory)
    require(
        MIN_WAYPOINTS <= count <= MAX_WAYPOINTS,
        f"plan(){what}: a trajectory has {MIN_WAYPOINTS} to {MAX_WAYPOINTS} waypoints, got {count}.",
    )
    for i, waypoint in enumerate(plan.trajectory):
        where = f"plan(){what}: waypoint {i}"
        require_share(waypoint.gripper, f"{where}: gripper")
        require(
            waypoint.speed > 0 and waypoint.tolerance > 0, f"{where}: speed and tolerance must be positive."
        )
        unknown = (waypoint.allowed_contacts | ({waypoint.carries} - {""})) - ids - {"table"}
        require(not unknown, f"{where}: it names {sorted(unknown)}, which are not in the scene.")
    for i, pose in enumerate(plan.trajectory.poses(request.start)):
        require_rigid(pose, f"plan(){what}: the resolved pose of waypoint {i}")
    json.dumps(plan.trajectory.to_json())


def check_skill(skill: Skill, call: SkillCall | None = None, request: PlanRequest | None = None) -> None:
    """The skill's table entry, its defaults, its proposals and a plan by ``call`` in the scene of ``request``.

    Without them the red cube of the built-in scene (two cubes under a gantry) is the theme, and the blue one the goal
    if the skill needs one; a skill for other objects needs both. It must find a plan there.
    """
    require(not fault_of(skill), f"The skill {fault_of(skill)}")
    require(skill.words, f"'{skill.name}' has no words: lessons about it would only be found by its name.")
    asked = request or inputs.plan_request()
    red, blue = (o.id for o in asked.scene.objects[:2]) if call is None else ("", "")
    called = call or SkillCall(skill.name, red, blue if skill.aimed else "")
    theme = asked.scene[called.theme]
    with allowed("defaults()"):
        theta = dict(skill.defaults(theme, asked.arm.hand, SkillOptions()))
    known = {p.name: p for p in skill.parameters}
    require(
        set(theta) == set(known), f"defaults() gives {sorted(theta)}, the parameters are {sorted(known)}."
    )
    for name, value in theta.items():
        least, most = known[name].least, known[name].most
        require(isfinite(value), f"The default of {name} is {value}.")
        require(least <= value <= most, f"The default of {name} is {value:g}, out of {least:g} to {most:g}.")
    goal = asked.scene[called.goal] if called.goal else None
    with allowed("propose()"):
        arm = asked.arm
        found = skill.propose(Job(skill.name, asked.scene, arm.hand, arm.workspace, theta, theme, goal))
    if not isinstance(found, Abstention):
        for proposal in found:
            require_type(proposal, Proposal, "What propose() returns")
    with allowed("carry_out()"):
        plan = carry_out([called], replace(asked, skills={**STANDARD, skill.name: skill}))
    refused = plan.abstention.message if plan.abstention is not None else ""
    require(plan.trajectory is not None, f"'{skill.name}' finds no way in a plain scene: {refused}")
