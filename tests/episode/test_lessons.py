"""From episodes to lessons: what a success and a failure of each kind teach, in words and effects."""

from dataclasses import replace
from typing import Any

import pytest

from gvla2.episode.lessons import memory_episode, transcript
from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.planning.contracts import Abstention, Plan
from gvla2.planning.effects import Bound, effect_from_json
from gvla2.planning.trajectory import Waypoint
from tests.objects import scene
from tests.picking import (
    DOWN,
    FAIL,
    SCENE,
    SUCCESS,
    THETA,
    UNCERTAIN,
    cube,
    effects_of,
    episode,
    kinds,
)


def test_success_gives_priors_whose_words_repeat() -> None:
    first = memory_episode(episode(), SUCCESS)
    other = episode(
        theta={**THETA, "grasp_depth": 0.021}, instruction="Grab the blue one", roles={"theme": "b"}
    )
    second = memory_episode(other, SUCCESS)
    assert [lesson.type for lesson in first.lessons] == ["procedural_hint"] * 4
    effects = effects_of(first.lessons)
    assert {(e.kind, e.parameter, e.value, e.count, e.skill) for e in effects} == {
        ("prior", "grasp_depth", 0.025, 1, "pick"),
        ("prior", "approach_tilt", 0.0, 1, "pick"),
        ("prior", "standoff", 0.05, 1, "pick"),
    }
    shown = [[x.content for x in one.lessons] for one in (first, second)]
    assert [text.replace("red", "blue") for text in shown[0]] == shown[1], "alike but for the look"
    assert {e.object for e in effects} == {"red"}
    assert "small red box from the top" in first.lessons[0].content
    assert first.source == "run/1"
    assert first.provenance["planner"] == "skill"


def bounds(record: EpisodeRecord) -> list[tuple[str, str, str, float]]:
    lessons = memory_episode(record, FAIL).lessons
    assert all(lesson.type == "failure_avoidance" for lesson in lessons)
    found = [effect_from_json(lesson.effect) for lesson in lessons if lesson.effect]
    return [
        (e.kind, e.parameter, e.op, pytest.approx(e.value, abs=1e-9)) if isinstance(e, Bound) else e
        for e in found
    ]


def test_a_slip_asks_for_a_deeper_grasp_within_the_object() -> None:
    slipped = {4: {"held": False, "gripper_width": 0.0, "abort": "slipped", "message": "lost"}}
    assert kinds(episode(slipped)) == ["slip"]
    assert bounds(episode(slipped)) == [("bound", "grasp_depth", ">=", 0.03)]
    deep = episode(slipped, theta={**THETA, "grasp_depth": 0.048})
    assert bounds(deep) == [("bound", "grasp_depth", ">=", 0.05)]
    assert kinds(episode({4: {"held": False}})) == ["slip"]
    assert bounds(episode(slipped, theta={})) == []


def test_contact_on_the_way_asks_for_more_clearance() -> None:
    touched = episode({0: {"contacts": ("panda_hand",)}})
    assert bounds(touched) == [("bound", "transit_clearance", ">=", 0.07)]
    lifting = episode({0: {"abort": "collision"}}, theta={"lift_height": 0.1})
    assert bounds(lifting) == [("bound", "lift_height", ">=", 0.13)]
    # Fingers touch what they grasp and carry.
    assert kinds(episode({i: {"contacts": ("panda_leftfinger",)} for i in (1, 2, 3, 4)})) == []


PUSH = (
    Waypoint((0.2, 0.1, 0.77), 0.0, "lower", DOWN),
    Waypoint((0.45, 0.1, 0.77), 0.0, "push", DOWN, allowed_contacts=frozenset({"a"})),
)


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (0.56, [("bound", "push_overshoot", "<=", -0.04)]),
        (0.42, [("bound", "push_overshoot", ">=", 0.1)]),
        (0.505, []),
    ],
)
def test_a_push_is_corrected_by_its_error_along_the_way(x: float, expected: list[Any]) -> None:
    after = scene(cube("z", 0.3, -0.2, "blue"), cube("y", x, 0.12, "red"))
    record = episode(skill="push", waypoints=PUSH, roles={"theme": "a", "goal": "goal"},
                     theta={"push_overshoot": 0.02}, after_scene=after)  # fmt: skip
    assert bounds(record) == expected


def test_an_undiagnosed_failure_teaches_words_alone() -> None:
    (lesson,) = memory_episode(episode(), FAIL).lessons
    assert lesson.type == "failure_avoidance"
    assert lesson.effect is None
    assert memory_episode(episode(), UNCERTAIN).lessons == ()
    (lesson,) = memory_episode(episode({1: {"abort": "tracking"}}), FAIL).lessons
    assert "stopped at 'grasp' (tracking)" in lesson.content


def test_a_transcript_describes_the_episode_and_is_bounded() -> None:
    record = episode({4: {"abort": "slipped", "message": "lost", "contacts": ("panda_hand",)}},
                     failure=Failure("execute", "slipped", "lost"), after_scene=SCENE)  # fmt: skip
    text = transcript(record)
    for words in ("Pick up the red cube", "a: red cube", "grasp_depth 0.025", "contact of panda_hand",
                  "STOPPED (slipped)", "Ended at execute"):  # fmt: skip
        assert words in text
    crowd = scene(*(cube(f"object-{i}", 0.1, 0.1, "red") for i in range(400)))
    assert len(transcript(replace(record, scene=crowd))) <= 8000
    assert "declined (other)" in transcript(
        replace(record, plan=Plan(None, abstention=Abstention("other", "no")))
    )
