"""The one entry: what every skill call becomes, and which calls are refused before anything moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.planning.calls import GraspOptions, SkillCall, SkillOptions
from gvla2.planning.contracts import Advice, Done
from gvla2.planning.effects import Bound, Prior
from gvla2.skills.carry_out import carry_out
from gvla2.skills.table import STANDARD
from tests.skills.scenes import (
    LAMP,
    PATCH,
    POST,
    RING,
    TABLE,
    TRAY,
    at,
    box,
    cube,
    drawer,
    jar,
    request,
    sound,
    stuck_brick,
)

A, B = cube("a", (0.3, 0.1)), cube("b", (0.25, -0.2))


@pytest.mark.parametrize(
    ("call", "objects", "skill", "roles"),
    [
        (SkillCall("pick", "a"), (A, B), "pick", {"theme": "a"}),
        (SkillCall("place", "a", "tray", relation="in"), (A, TRAY), "place", {"theme": "a", "goal": "tray"}),
        (SkillCall("place", "a", direction=(0, 1), amount=0.1), (A,), "place", {"theme": "a"}),
        (SkillCall("push", "a", "patch"), (A, PATCH), "push", {"theme": "a", "goal": "patch"}),
        (SkillCall("press", "lamp"), LAMP, "press", {"theme": "knob", "part": "knob"}),
        (SkillCall("twist", "jar", "patch"), (*jar(), PATCH), "twist", {"theme": "cap", "goal": "patch"}),
        (SkillCall("open", "jar"), jar(), "twist", {"theme": "cap"}),
        (SkillCall("pick", "cap"), jar(), "twist", {"theme": "cap"}),
        (SkillCall("place", "ring", "post"), (RING, POST), "insert", {"theme": "ring", "goal": "post"}),
        (SkillCall("open", "box"), box(0.0), "open", {"theme": "box"}),
        (SkillCall("pick", "lid"), box(0.0), "open", {"theme": "lid"}),
        (SkillCall("close", "box"), box(2.618), "close", {"theme": "box"}),
        (SkillCall("place", "lid", "box"), box(2.618), "close", {"theme": "lid"}),
        (SkillCall("open", "cabinet"), drawer(), "pull", {"theme": "cabinet"}),
        (SkillCall("pick", "bar"), drawer(), "pull", {"theme": "bar"}),
        (SkillCall("draw", "brick", xy=(0.4, 0.2)), stuck_brick(), "draw", {"theme": "brick"}),
        (SkillCall("pick", "brick"), stuck_brick(), "draw", {"theme": "brick"}),
    ],
)
def test_a_call_is_carried_out_as_the_object_asks_for_it(call, objects, skill, roles):
    asked = request(*objects)
    plan = sound(carry_out([call], asked), asked)
    assert (plan.skill, dict(plan.roles)) == (skill, roles)
    assert plan.calls == (call,)
    assert plan.remaining == ()
    assert set(plan.parameters) == {p.name for p in STANDARD[skill].parameters}
    for name in plan.parameters:
        parameter = next(p for p in STANDARD[skill].parameters if p.name == name)
        assert parameter.least <= plan.parameters[name] <= parameter.most, name


def test_places_and_directions_are_where_the_middle_ends():
    asked = request(A)
    free = carry_out([SkillCall("place", "a", xy=(0.4, -0.1))], asked)
    np.testing.assert_allclose(at(free, "place")[:2], (0.4, -0.1), atol=1e-9)
    aside = carry_out([SkillCall("place", "a", direction=(0, 2.0), amount=0.12)], asked)
    np.testing.assert_allclose(at(aside, "place")[:2] - A.centre[:2], (0, 0.12), atol=1e-9)


def test_a_lift_height_that_is_raised_is_reported_and_an_amount_is_kept():
    low = SkillOptions(lift_height=0.02)
    plan = carry_out([SkillCall("pick", "a")], request(A), low)
    assert plan.parameters["lift_height"] == pytest.approx(0.03)
    assert plan.notes[0].startswith("lift_height: 0.02 -> 0.03 to clear")
    plan = carry_out([SkillCall("pick", "a", amount=0.02)], request(A), low)
    assert plan.parameters["lift_height"] == pytest.approx(0.02)
    assert not [note for note in plan.notes if "lift_height" in note]


def test_an_amount_and_theta_override_the_defaults_and_memory_bounds_them():
    asked = request(A, effects=[Bound("standoff", 0.06, ">=", skill="pick", source="r1")])
    plan = carry_out([SkillCall("pick", "a", amount=0.1, theta={"standoff": 0.02})], asked)
    assert plan.parameters["lift_height"] == pytest.approx(0.1)
    assert plan.parameters["standoff"] == pytest.approx(0.06)
    assert carry_out([SkillCall("pick", "a")], asked, SkillOptions(lift_height=0.15)).parameters[
        "lift_height"
    ] == pytest.approx(0.15)
    pulled = carry_out([SkillCall("open", "drawer", amount=0.08)], request(*drawer()))
    assert pulled.parameters["pull_distance"] == pytest.approx(0.08)


def test_options_replace_defaults_of_parameters_and_say_how_grasps_are_chosen():
    pick = [SkillCall("pick", "a")]
    plan = carry_out(pick, request(A), SkillOptions(parameters={"standoff": 0.08, "turn": 1.0}))
    assert plan.parameters["standoff"] == pytest.approx(0.08)
    wrong = carry_out(pick, request(A), SkillOptions(parameters={"standof": 0.08}))
    assert "There are standoff, approach_tilt" in wrong.abstention.message
    careful = SkillOptions(grasp=GraspOptions(clearance=0.04))
    assert "40 mm of clearance" in carry_out(pick, request(A), careful).abstention.message
    with pytest.raises(ConfigurationError, match=r"planner\.grasp\.clearance"):
        GraspOptions(clearance=-0.1)


def turned(plan) -> float:
    """Radians by which the hand turns while it holds, as its closing direction tells."""
    ways = [w.orientation.closing for w in plan.trajectory if w.stage in ("close", "turn")]
    angles = np.unwrap([np.arctan2(y, x) for x, y, _ in ways])
    return float(angles[-1] - angles[0])


def test_memory_does_not_overrule_what_the_call_says():
    mean, least = Prior("turn", 1.75, count=3, skill="twist"), Bound("turn", 1.9, ">=", skill="twist")
    for effects, turn in (((mean,), -0.5), ((least,), -0.5), ((mean, least), 0.0), ((least,), 2.1)):
        asked = replace(request(*jar()), advice=Advice("", effects))
        call = SkillCall("twist", "cap", theta={"turn": turn})
        assert carry_out([call], asked).parameters["turn"] == pytest.approx(turn)
    # A bound of the same sense holds, and a mean where nothing is said.
    assert carry_out([replace(call, theta={"turn": 1.0})], asked).parameters["turn"] == pytest.approx(1.9)
    asked = replace(asked, advice=Advice("", (mean,)))
    assert carry_out([SkillCall("twist", "cap")], asked).parameters["turn"] < 2.8


def test_what_was_turned_stays_turned_and_exploring_goes_on_step_by_step():
    jars, twist = jar(), SkillCall("twist", "cap")
    place = tuple(jars[1].centre)
    advice = Advice("", (Bound("turn", 3.6, ">=", skill="twist"),), (), (Done("twist", "turn", 2.8, place),))
    asked = request(*jars)
    assert turned(carry_out([twist], asked)) == pytest.approx(2.88)
    again = replace(asked, advice=advice)
    step = carry_out([twist], again, SkillOptions(explore=0.3))
    assert (step.parameters["turn"], turned(step)) == (pytest.approx(3.6), pytest.approx(0.8))
    whole = carry_out([twist], again)
    assert (whole.parameters["turn"], turned(whole)) == (pytest.approx(6.4), pytest.approx(3.6))
    elsewhere = Done("twist", "turn", 2.8, (0.0, 0.0, 0.0))
    back = Done("twist", "turn", -2.8, place)
    for other in (elsewhere, back):  # another cap; the other way
        plan = carry_out([twist], replace(asked, advice=replace(advice, done=(other,))))
        assert (plan.parameters["turn"], turned(plan)) == (pytest.approx(3.6), pytest.approx(3.6))


def test_a_part_that_only_moves_with_its_whole_means_the_whole():
    grip = object_on_knife = replace(
        cube("grip", (0.3, 0.1), 0.03, 0.0), parent="knife", world_from_object=A.world_from_object
    )
    knife = replace(cube("knife", (0.3, 0.1), 0.05, 0.2))
    plan = carry_out([SkillCall("place", "grip", xy=(0.4, -0.1))], request(knife, object_on_knife))
    assert grip.parent == plan.roles["theme"] == "knife"


@pytest.mark.parametrize(
    ("call", "kind", "said"),
    [
        (SkillCall("pikc", "a"), "unknown_skill", "Did you mean 'pick'?"),
        (SkillCall("pick", "moon"), "nothing_matches", "a (object a)"),
        (SkillCall("place", "a", "a"), "other", "its own goal"),
        (SkillCall("place", "jar", "cap"), "other", "part of"),
        (SkillCall("place", "a"), "no_goal", "not said"),
        (SkillCall("place", "a", "tray", xy=(0.3, 0.0)), "other", "Only one of"),
        (SkillCall("place", "a", xy=(0.3, 0.0), relation="in"), "other", "needs a goal"),
        (SkillCall("insert", "a", "tray"), "other", "no hole"),
        (SkillCall("insert", "a", "tray", relation="beside"), "other", "not have the relation 'beside'"),
        (SkillCall("pick", "patch"), "other", "painted"),
        (SkillCall("pick", "a", amount=-0.1), "other", "must be positive"),
        (SkillCall("press", "a"), "nothing_matches", "cannot be pressed"),
        (SkillCall("open", "a"), "unknown_skill", "No lid"),
        (SkillCall("pull", "a"), "unknown_skill", "no visible handle"),
        (SkillCall("twist", "jar", amount=0.05, direction=(0.0, 0.0)), "other", "must not be (0, 0)"),
        (SkillCall("push", "a", "tray", amount=0.1), "other", "only with a direction"),
        (SkillCall("place", "a", "tray", amount=0.1), "other", "only with a direction"),
        (SkillCall("pick", "a", theta={"standoff": 3.0}), "other", "from 0 to 0.2 m"),
        (SkillCall("place", "a", xy=(5.0, 5.0)), "unreachable", "workspace"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_words_that_help(call, kind, said):
    plan = carry_out([call], request(A, TRAY, PATCH, *jar()))
    assert plan.trajectory is None
    assert plan.abstention.kind == kind, plan.abstention
    assert said in plan.abstention.message


def test_an_empty_program_and_a_later_unknown_are_refused_before_motion():
    assert carry_out([], request(A)).abstention.kind == "other"
    plan = carry_out([SkillCall("pick", "a"), SkillCall("place", "a", "moon")], request(A))
    assert plan.abstention.kind == "nothing_matches"
    plan = carry_out([SkillCall("pick", "a"), SkillCall("place", "b", "b")], request(A, B))
    assert "its own goal" in plan.abstention.message


def test_picking_and_placing_is_one_placing():
    asked = request(A, TRAY)
    calls = [SkillCall("pick", "a", theta={"standoff": 0.05}), SkillCall("place", "a", "tray", relation="in")]
    plan = sound(carry_out(calls, asked), asked)
    assert (plan.skill, plan.calls, plan.remaining) == ("place", tuple(calls), ())
    assert plan.parameters["standoff"] == pytest.approx(0.05)
    calls = [SkillCall("open", "jar"), SkillCall("place", "cap", "patch")]
    asked = request(*jar(), PATCH)
    plan = sound(carry_out(calls, asked), asked)
    assert (plan.skill, plan.calls) == ("twist", tuple(calls))
    assert at(plan, "release")[2] < TABLE + 0.1


def test_what_is_beyond_one_part_remains():
    asked = request(A, B, *drawer((0.30, 0.25)))
    calls = (SkillCall("open", "drawer"), SkillCall("pick", "a"), SkillCall("place", "a", "b"))
    options = SkillOptions(lift_height=0.2)
    plan = sound(carry_out(calls, asked, options), asked)
    assert (plan.skill, plan.calls, plan.remaining) == ("pull", calls[:1], calls[1:])
    assert plan.options == options
    stack = (SkillCall("place", "a", "b"), SkillCall("place", "b", "a"))
    assert carry_out(stack, asked).remaining == stack[1:]


def test_several_objects_into_containers_are_one_trajectory_side_by_side():
    objects = (cube("a", (0.3, 0.0), 0.04), cube("b", (0.25, -0.2), 0.04), cube("c", (0.35, -0.25), 0.04))
    objects = (*objects, cube("d", (0.2, 0.1), 0.04))
    asked = request(*objects, TRAY)
    calls = tuple(SkillCall("place", name, "tray", relation="in") for name in "abcd")
    plan = sound(carry_out(calls, asked), asked)
    assert plan.roles["theme_1"] == "a"
    assert plan.calls == calls[: len(plan.calls)]
    assert plan.calls + plan.remaining == calls
    assert len(plan.calls) > 1
    places = [np.array(w.xyz[:2]) for w in plan.trajectory if w.stage == "release"]
    gaps = [np.linalg.norm(p - q) for i, p in enumerate(places) for q in places[:i]]
    assert min(gaps) > 0.04
