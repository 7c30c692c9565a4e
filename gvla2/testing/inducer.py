"""Conformance of inducers."""

from __future__ import annotations

from gvla2.memory.contracts import Inducer, Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.testing.conformance import allowed, require, require_type

OWN = Lesson("tool_usage", "Ask for the second camera first.")
TYPES = ("procedural_hint", "failure_avoidance", "tool_usage")


def check_inducer(inducer: Inducer) -> None:
    """Whether an inducer answers any episode with valid lessons, and drops none of an episode's own.

    It must not raise if it finds nothing or cannot ask its model.
    """
    verdicts = (
        Verdict.from_criteria({"completion": 1.0}),
        Verdict.from_criteria({"completion": 0.0}),
        Verdict.unavailable("nobody was there"),
    )
    task = MemoryTask("Pick up the red cube")
    for transcript in ("", "- moved to the cube\n- closed the fingers\nerror: it slipped"):
        for own in ((), (OWN,)):
            for verdict in verdicts:
                with allowed("induce()"):
                    lessons = inducer.induce(MemoryEpisode(task, own, transcript), verdict)
                require_type(lessons, tuple, "What induce() returns")
                for lesson in lessons:
                    require_type(lesson, Lesson, "What induce() gives")
                    require(lesson.type in TYPES, f"'{lesson.type}' is not a type of lesson.")
                    require(bool(lesson.content.strip()), "A lesson needs words.")
                require(set(own) <= set(lessons), "induce() lost one of the episode's own lessons.")
