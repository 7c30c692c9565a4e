"""Options that tasks share."""

from __future__ import annotations

from dataclasses import dataclass

from gvla2.component import ComponentConfig


@dataclass
class TaskConfig(ComponentConfig):
    """Base of a task's configuration: a task whose options extend it can be cluttered (:mod:`gvla2.robot.clutter`).

    ``distractors`` things lie beside what the task needs. They are simple shapes, or meshes of the folder
    ``distractors_root``; ``arrangement`` is "apart", "touching" (in pairs), "leaning" (a board against a block),
    "stack" (threes, one on another) or "mixed".
    """

    distractors: int = 0
    distractors_root: str = ""
    arrangement: str = "apart"
