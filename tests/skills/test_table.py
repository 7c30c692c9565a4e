"""The table of skills: whole, callable, told as text; and what is no skill."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gvla2.catalog import assemble
from gvla2.discovery import Offering, Plugin
from gvla2.kinds import SKILL_HOOK
from gvla2.skills.skill import Parameter, Role, Skill, fault_of
from gvla2.skills.table import PARAMETERS, STANDARD, describe

PICK = STANDARD["pick"]


@pytest.mark.parametrize("skill", STANDARD.values(), ids=lambda s: s.name)
def test_standard_skills_are_whole(skill: Skill):
    assert fault_of(skill) == ""
    assert skill.words
    assert skill.key
    assert {p.name for p in skill.parameters} <= set(PARAMETERS)
    assert all(p.least < p.most and p.meaning for p in skill.parameters)


def test_the_table_as_text_is_a_line_a_skill_with_units_on_request():
    lines = describe().splitlines()
    assert [line.partition("(")[0] for line in lines] == list(STANDARD)
    assert "place(theme, goal | xy | direction, relation=on|in|" in describe()
    assert "grasp_depth [m]" in describe(numbers=True)
    assert "rad" not in describe()


@pytest.mark.parametrize(
    ("offered", "said"),
    [
        ("pick", "not a Skill"),
        (replace(PICK, name="Pick Up"), "small letters"),
        (replace(PICK, name=3), "small letters"),
        (replace(PICK, roles=()), "no role 'theme'"),
        (replace(PICK, roles=("theme",)), "no sequence of Role"),
        (replace(PICK, parameters=None), "no sequence of Parameter"),
        (replace(PICK, propose=None), "propose that cannot be called"),
        (replace(PICK, key=("grip",)), "'grip'"),
        (replace(PICK, amount="height"), "'height'"),
        (replace(PICK, description=""), "no description"),
    ],
)
def test_what_is_no_skill_is_said_and_left_out(offered, said):
    registry = assemble([], [Offering(Plugin("mine"), SKILL_HOOK, (offered, replace(PICK, name="mine")))])
    assert list(registry.skills) == ["mine"]
    (problem,) = registry.problems
    assert said in problem.message
    assert (problem.plugin, problem.hook) == ("mine", SKILL_HOOK)


def test_of_two_skills_of_one_name_the_first_wins():
    first, second = Plugin("first"), Plugin("second")
    registry = assemble([], [Offering(first, SKILL_HOOK, (PICK,)), Offering(second, SKILL_HOOK, (PICK,))])
    assert registry.skill_plugin("pick") == first
    assert "already offered by plugin 'first'" in registry.problems[0].message


def test_a_signature_says_what_may_be_left_out():
    optional = Skill(
        "wipe", "wipe", (Role("theme", "t"), Role("goal", "g", required=False)),
        (Parameter("far", "m", "how far"),), PICK.propose, PICK.defaults, amount="far",
    )  # fmt: skip
    assert optional.signature() == "wipe(theme, [goal], amount=)"
    assert not optional.aimed
    assert STANDARD["place"].aimed
