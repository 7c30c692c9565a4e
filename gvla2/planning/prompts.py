"""Scenes as text: for planners that are language models, and for a run's page."""

from __future__ import annotations

import math
import re

from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Box, Scene, SceneObject

BEGIN, END = "<scene>", "</scene>"
_MARK = re.compile(r"<(?=\s*/?\s*memory\b)", re.IGNORECASE)


def remembered(text: str) -> str:
    """What memory says, between marks that nothing in it can end; "" where it says nothing."""
    return f"<memory>\n{_MARK.sub('(', text.strip())}\n</memory>" if text.strip() else ""


def scene_to_text(scene: Scene) -> str:
    """X_t as lines between ``<scene>`` and ``</scene>``: data to a language model, never instructions.

    Metres with three decimals in the world frame (x forward from the robot, z up), yaw in degrees. One object a
    block, in the scene's order; the same scene gives the same text. What perception wrote (labels, notes) is kept
    to one line each and cannot end the block.
    """
    lines = [
        BEGIN,
        "frame: world, x forward from the robot, y left, z up; metres; yaw about z in degrees",
        f"table_height: {_number(scene.table_height)}",
        f"workspace: {_span(scene.workspace)}",
        f"objects: {len(scene.objects)}",
    ]
    for thing in scene.objects:
        lines += _object_lines(thing)
    lines += [f"note: {_plain(note)}" for note in scene.notes]
    return "\n".join([*lines, END])


def _object_lines(thing: SceneObject) -> list[str]:
    axis = thing.world_from_object[:3, 0]
    yaw = math.degrees(math.atan2(float(axis[1]), float(axis[0])))
    part = f" part_of={_plain(thing.parent)}" if thing.parent else ""
    colour = f" colour={_plain(thing.colour)}" if thing.colour else ""
    points = " ".join(
        f"{name}={_vector(point)}" for name, point in thing.keypoints().items() if name != "centre"
    )
    return [
        f'- {_plain(thing.id)}: "{_plain(thing.label)}" shape={thing.shape}{colour}{part} '
        f"confidence={thing.confidence:.2f}",
        f"  centre={_vector(thing.centre)} size={_vector(thing.extents)} yaw={_number(yaw, 1)}",
        f"  {points}",
    ]


def _number(value: float, decimals: int = 3) -> str:
    """Without a minus before zero, which would make equal scenes differ."""
    return f"{round(float(value), decimals) + 0.0:.{decimals}f}"


def _vector(values: FloatArray) -> str:
    return "(" + ", ".join(_number(v) for v in values) + ")"


def _span(box: Box) -> str:
    return f"{_vector(box.low)} to {_vector(box.high)}"


def _plain(text: str) -> str:
    """One line, without the characters that could close a quotation or the block."""
    return " ".join(text.split()).replace("<", "(").replace(">", ")").replace('"', "'")
