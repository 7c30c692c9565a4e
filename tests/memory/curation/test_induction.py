"""Lessons by rules: the episode's own, else steps of a success or what went wrong."""

from typing import Any

import pytest

from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask
from gvla2.memory.curation.induction import MAX_CONTENT, RulesInducer

TRANSCRIPT = """I will look at the tests.
$ pytest -x
FAILED test_parser.py::test_comma - IndexError: list index out of range
$ sed -i s/i+1/i/ parser.py
$ pytest -x
1 passed"""


def induce(verdict: Any, *lessons: Lesson, transcript: str = TRANSCRIPT) -> tuple[Lesson, ...]:
    episode = MemoryEpisode(MemoryTask("Fix the parser"), lessons, transcript=transcript)
    return RulesInducer().induce(episode, verdict)


def test_own_lessons_are_taken_as_they_are(verdicts: Any) -> None:
    own = Lesson("tool_usage", "The crane needs air.")
    assert induce(verdicts["success"], own) == (own,)


def test_a_success_gives_its_steps(verdicts: Any) -> None:
    (lesson,) = induce(verdicts["success"])
    assert lesson.type == "procedural_hint"
    assert lesson.content == (
        "Fix the parser: these steps led to the end: pytest -x; sed -i s/i+1/i/ parser.py"
    )


def test_a_failure_gives_what_went_wrong_and_no_recipe(verdicts: Any) -> None:
    (lesson,) = induce(verdicts["fail"])
    assert lesson.type == "failure_avoidance"
    assert "IndexError" in lesson.content
    (bare,) = induce(verdicts["fail"], transcript="- pushed the cup\n- looked")
    assert bare.type == "failure_avoidance"
    assert "looked" in bare.content


@pytest.mark.parametrize("transcript", ["", "   \n", "nothing that looks like a step"])
def test_nothing_to_learn_from_gives_nothing(verdicts: Any, transcript: str) -> None:
    assert induce(verdicts["success"], transcript=transcript) == ()
    assert induce(verdicts["fail"], transcript=transcript) == ()


def test_lessons_are_bounded(verdicts: Any) -> None:
    (lesson,) = induce(
        verdicts["success"], transcript="\n".join(f"- step {i} {'x' * 500}" for i in range(50_000))
    )
    assert len(lesson.content) <= MAX_CONTENT
