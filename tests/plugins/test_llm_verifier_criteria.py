"""The criteria sets."""

import pytest

from gvla2.errors import ConfigurationError
from gvla2_plugins.llm_verifier.criteria import criteria_set


def test_the_sets_are_the_papers():
    assert [c.name for c in criteria_set("robot")] == [
        "task_completion",
        "spatial_consistency",
        "collision_safety",
        "execution_validity",
        "generalizability",
    ]
    assert [c.name for c in criteria_set("software")] == [
        "root_cause",
        "code_quality",
        "empirical_verification",
    ]
    assert all(len(c.question) > 60 for name in ("robot", "software") for c in criteria_set(name))


def test_questions_of_ones_own_replace_the_set():
    (criterion,) = criteria_set("robot", {"speed": "Was it done within a minute?"})
    assert (criterion.name, criterion.question) == ("speed", "Was it done within a minute?")


@pytest.mark.parametrize(
    ("name", "questions", "word"),
    [
        ("robots", None, "Did you mean 'robot'"),
        ("", {}, "Sets: robot, software"),
        ("robot", {"speed": " "}, "empty"),
    ],
)
def test_what_does_not_exist_is_explained(name: str, questions: dict[str, str] | None, word: str):
    with pytest.raises(ConfigurationError, match=word):
        criteria_set(name, questions)
