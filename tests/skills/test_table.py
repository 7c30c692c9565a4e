"""The table of skills: whole, callable, reported as text; and what is no skill."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace

import pytest

import gvla2
from gvla2.hookspecs import SKILL_HOOK
from gvla2.planning.skill import Parameter, Role, Skill, fault_of
from gvla2.plugins.registry import load_plugins
from gvla2.skills.parameters import PARAMETERS
from gvla2.skills.table import STANDARD

PICK = STANDARD["pick"]


@pytest.fixture
def register() -> Iterator[Callable[..., object]]:
    """Offers skills in this process: ``register(plugin, *skills)``."""
    names = []

    def make(plugin: str, *skills: object) -> None:
        names.append(gvla2.register(SimpleNamespace(gvla2_skills=gvla2.hookimpl(lambda: skills)), plugin))

    yield make
    for name in names:
        gvla2.unregister(name)


@pytest.mark.parametrize("skill", STANDARD.values(), ids=lambda s: s.name)
def test_standard_skills_are_whole(skill: Skill):
    assert fault_of(skill) == ""
    assert skill.words
    assert skill.key
    assert {p.name for p in skill.parameters} <= set(PARAMETERS)
    assert all(p.least < p.most and p.meaning for p in skill.parameters)


@pytest.mark.parametrize(
    ("offered", "said"),
    [
        ("pick", "not a Skill"),
        (replace(PICK, name="Pick Up"), "small letters"),
        (replace(PICK, roles=()), "no role 'theme'"),
        (replace(PICK, roles=("theme",)), "not a sequence of Role"),
        (replace(PICK, propose=None), "cannot be called"),
        (replace(PICK, key=("grip",)), "'grip'"),
        (replace(PICK, description=""), "no description"),
    ],
)
def test_what_is_no_skill_is_said_and_left_out(register, offered, said):
    register("mine", offered, replace(PICK, name="mine"))
    registry = load_plugins()
    assert set(registry.skills) == {"mine", *STANDARD}
    (problem,) = registry.problems
    assert said in problem.message
    assert (problem.plugin, problem.hook) == ("mine", SKILL_HOOK)


def test_of_two_skills_of_one_name_the_first_wins(register):
    register("mine", PICK)
    registry = load_plugins()
    assert registry.skills_offered["pick"][1].name == "mine"
    (problem,) = registry.problems
    assert "already offered by plugin 'mine'" in problem.message


def test_a_signature_says_what_may_be_left_out():
    optional = Skill(
        "wipe", "wipe", (Role("theme", "t"), Role("goal", "g", required=False)),
        (Parameter("far", "m", "how far"),), PICK.propose, PICK.defaults, amount="far",
    )  # fmt: skip
    assert optional.signature() == "wipe(theme, [goal], amount=)"
    assert not optional.aimed
    assert STANDARD["place"].aimed
