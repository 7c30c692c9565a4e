"""Lessons of picking a small box up, for tests of banks."""

from typing import Any

from gvla2.memory.contracts import Lesson

BOUND = {"kind": "bound", "parameter": "grasp_depth", "value": 0.03, "op": ">=", "sd": 0.0, "count": 0,
         "skill": "pick", "source": ""}  # fmt: skip
AVOID = Lesson("failure_avoidance", "Pick up a small box: failed because the object slipped.", BOUND)
TOOL = Lesson("tool_usage", "Pick up a small box: ask for the wrist camera first.")


def prior(value: float, count: int = 1, sd: float = 0.0) -> dict[str, Any]:
    return {"kind": "prior", "parameter": "grasp_depth", "value": value, "sd": sd, "count": count, "op": ">="}


def lesson(value: float = 0.02) -> Lesson:
    return Lesson("procedural_hint", "Pick up a small box: this grasp depth succeeded.", prior(value))
