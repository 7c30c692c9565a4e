"""Conformance of skills: whether planners can call it, and whether its plans pass the checks."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Abstention, PlanRequest
from gvla2.skills.carry_out import carry_out
from gvla2.skills.proposals import Job, Proposal
from gvla2.skills.skill import Skill, fault_of
from gvla2.skills.table import STANDARD
from gvla2.testing import inputs
from gvla2.testing.conformance import allowed, require, require_type


def check_skill(skill: Skill, call: SkillCall | None = None, request: PlanRequest | None = None) -> None:
    """The skill's table entry, its defaults, its proposals and a plan by ``call`` in the scene of ``request``.

    Without them the red cube of the built-in scene (two cubes under a gantry) is the theme, and the blue one the goal
    if the skill needs one; a skill for other things needs both. It must find a plan there.
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
