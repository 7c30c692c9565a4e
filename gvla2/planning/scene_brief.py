"""The scene as text for a planner: short lines, unique names, and the object of each name.

Perceived labels are data: a label becomes a name of letters, digits and underscores, so that it can neither instruct a
language model nor end its line.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count

from gvla2.planning.calls import RELATIONS
from gvla2.planning.scene import Scene, SceneObject

LEGEND = (
    "name length x width x height at x,y (mm; x away from the robot, y to its left; height above the table)"
)
"""The format of a line of :func:`scene_brief` with sizes and positions."""
LONGEST_NAME = 40
RAISED = 15.0
"""Height of an object's lower side, millimetres, above which it is mentioned."""
TAKEN = frozenset([*keyword.kwlist, *RELATIONS, "left", "right", "forward", "back", "objects", "decline"])
"""Reserved words of programs, not used as names."""
UNSURE = 0.5
"""Objects seen with less confidence are marked."""


@dataclass(frozen=True)
class SceneBrief:
    """``text`` has one line per object; ``ids`` maps names to scene ids and ``names`` ids to names."""

    text: str
    ids: Mapping[str, str]
    names: Mapping[str, str]

    def named(self, words: str, scene: Scene) -> str:
        """The words on one line with names in place of labels and ids: perceived text must not reach a model through a
        rejection's reason.
        """
        named = {o.id: self.names[o.id] for o in scene.objects}
        named |= {o.label: self.names[o.id] for o in scene.objects if o.label}
        longest = "|".join(sorted(map(re.escape, named), key=len, reverse=True))
        if named:
            words = re.sub(rf"(?<!\w)(?:{longest})(?!\w)", lambda m: named[m.group()], words)
        return " ".join(words.split())


def scene_brief(scene: Scene, *, positions: bool = True) -> SceneBrief:
    """One line per object of the scene, in order: name, size and place in millimetres above the table.

    A part's name includes its whole's (``lid_of_lime_jar``), and equal names are numbered from the robot's left to its
    right. Two cubes take about 55 tokens.
    """
    names = unique_names(scene)
    lines = [_line(o, names[o.id], scene, positions) for o in scene.objects]
    return SceneBrief("\n".join(lines), {name: i for i, name in names.items()}, names)


def unique_names(scene: Scene) -> dict[str, str]:
    """A name for each object's id: its label, with that of the whole for a part, numbered if it is not unique."""
    labels = {o.id: _plain(o.label) or o.shape for o in scene.objects}
    plain = {o.id: _full_name(o, labels) for o in scene.objects}
    given = list(plain.values())
    names = {i: name for i, name in plain.items() if given.count(name) == 1}
    for obj in sorted(scene.objects, key=lambda o: -float(o.centre[1])):
        if obj.id not in names:
            numbered = (f"{plain[obj.id]}_{k}" for k in count(1))
            names[obj.id] = next(each for each in numbered if each not in names.values())
    return {o.id: names[o.id] for o in scene.objects}


def _full_name(obj: SceneObject, labels: Mapping[str, str]) -> str:
    whole = labels.get(obj.parent, "")
    if not whole:
        return labels[obj.id]
    # "gray lid" of "lime jar": the whole identifies it, its own colour is not needed.
    own = labels[obj.id].removeprefix(f"{_plain(obj.colour)}_") or labels[obj.id]
    head = whole.rpartition("_")[2]
    if head and own.startswith(f"{head}_"):
        own = own.removeprefix(f"{head}_")  # "lamp shade" of "lamp base" keeps its noun
    return f"{own}_of_{whole}"[:LONGEST_NAME].rstrip("_")


def _line(obj: SceneObject, name: str, scene: Scene, positions: bool) -> str:
    words = [name]
    length, width, height = _sizes(obj)
    flat = obj.shape == "region"
    words.append(f"{length}x{width} patch" if flat else f"{length}x{width}x{height}")
    if obj.opening > 0.0:
        words.append(f"open {_mm(obj.opening)}")
    bottom = obj.bottom - scene.table_height
    if positions:
        words.append(f"at {_mm(obj.centre[0])},{_mm(obj.centre[1])}")
        if not flat and 1e3 * bottom > RAISED:
            words.append(f"up {_mm(bottom)}")
    if positions and (place := _place_among(obj, scene)):
        words.append(f"({place})")
    if obj.confidence < UNSURE:
        words.append("(unsure)")
    if obj.named_by:
        words.append(f"(name {100 * obj.sureness:.0f}% sure)")
    return " ".join(words)


def _place_among(obj: SceneObject, scene: Scene) -> str:
    """Whether it is the left, right or middle one of several whole objects of its kind, from the scene's viewpoint."""
    kind = obj.label.rpartition(" ")[2]
    alike = [o for o in scene.objects if o.label.rpartition(" ")[2] == kind and not o.parent]
    if obj.parent or not 2 <= len(alike) <= 3:
        return ""
    order = [o.id for o in sorted(alike, key=lambda o: -float(o.centre @ scene.side("left_of")))].index(
        obj.id
    )
    return ("left", "right")[order] if len(alike) == 2 else ("left", "middle", "right")[order]


def _sizes(obj: SceneObject) -> tuple[int, int, int]:
    level = [i for i in range(3) if abs(obj.world_from_object[2, i]) < 0.7][:2] or [0, 1]
    width, length = sorted(float(obj.extents[i]) for i in level)
    return _mm(length), _mm(width), _mm(obj.top - obj.bottom)


def _mm(metres: float) -> int:
    return round(1e3 * float(metres))


def _plain(text: str) -> str:
    """Lower case letters, digits and underscores, bounded: a valid name in programs."""
    name = re.sub(r"[^a-z0-9]+", "_", text.casefold())[:LONGEST_NAME].strip("_")
    return f"object_{name}" if name and (name in TAKEN or name[0].isdigit()) else name
