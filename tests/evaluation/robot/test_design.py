"""The class that a failure belongs to."""

from dataclasses import replace

import pytest

from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.evaluation.suites.robot_episodes import failure_class

RECORD = EpisodeRecord("e", "lift it", "pick_and_lift", 0, {})


@pytest.mark.parametrize(
    ("stage", "kind", "expected"),
    [
        ("setup", "error", "setup"),
        ("observe", "error", "error"),
        ("perceive", "perception", "perception"),
        ("plan", "ambiguous", "perception"),
        ("plan", "nothing_matches", "perception"),
        ("plan", "too_wide", "abstained"),
        ("plan", "timeout", "timeout"),
        ("plan", "crashed", "error"),
        ("check", "rejected", "plan_rejected"),
        ("execute", "slipped", "grasp"),
        ("execute", "no_path", "execution"),
        ("verify", "not_achieved", "not_achieved"),
        ("success_check", "goal_not_reached", "unnoticed"),
    ],
)
def test_every_failure_has_a_class(stage, kind, expected):
    assert failure_class(replace(RECORD, failure=Failure(stage, kind, ""))) == expected
    assert failure_class(RECORD) == ""


def test_an_episode_whose_model_answered_nothing_says_nothing_of_its_planner():
    silent, once = {"failed": 3, "calls": 0, "cached": 0}, {"failed": 2, "calls": 1, "cached": 0}
    assert failure_class(replace(RECORD, language={"plan": silent})) == "unavailable", (
        "the fallback's success"
    )
    abstained = Failure("plan", "other", "no program that can be read")
    assert failure_class(replace(RECORD, language={"plan": silent}, failure=abstained)) == "unavailable"
    assert failure_class(replace(RECORD, language={"plan": once}, failure=abstained)) == "abstained"
    assert failure_class(replace(RECORD, language={"verify": silent})) == ""
