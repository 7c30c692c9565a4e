"""The skill, the object and the place: parsed from a simple instruction, or by asking the model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gvla2.language import json_in
from gvla2.planning.calls import RELATIONS, Relation
from gvla2.skills.skill import Skill


@dataclass(frozen=True)
class PointingTask:
    """A skill's name, the words for the theme, and for the goal if there is one, with its relation."""

    skill: str
    theme: str
    goal: str = ""
    relation: Relation = ""


_WHERE: Mapping[str, Relation] = {
    "onto": "on", "on top of": "on", "on": "on", "into": "in", "inside": "in", "in": "in", "next to": "beside",
    "beside": "beside", "to the left of": "left_of", "left of": "left_of", "to the right of": "right_of",
    "right of": "right_of", "behind": "behind", "in front of": "front_of",
}  # fmt: skip
_PLACES = "|".join(sorted(_WHERE, key=len, reverse=True))
_PLACING = re.compile(
    rf"(?:put|place|set|lay)\s+(?P<theme>.+?)\s+(?P<where>{_PLACES})\s+(?P<goal>.+)", re.IGNORECASE
)
_PICKING = re.compile(
    r"(?:pick\s+up|lift(?:\s+up)?|grasp|grab)\s+(?P<theme>.+?)(?:\s+(?:off|from)\s+the\s+table)?",
    re.IGNORECASE,
)
_TWISTED = re.compile(
    r"\b(?:and|then|or|but|not|n't|no|never|without|except|if|until|all|every|each|both|"
    r"\d+|cm|mm|that|which|it|them)\b|[,;:.!?]\s*\S",
    re.IGNORECASE,
)
"""Words absent from simple instructions; with one of these the model is asked."""


def read_simply(instruction: str) -> PointingTask | None:
    """The task of one verb, one object and at most one place; None for anything less plain."""
    words = " ".join(instruction.split()).strip(" .!")
    if _TWISTED.search(words):
        return None
    if found := _PLACING.fullmatch(words):
        # "the cup on the tray on the box" has two ways to be read.
        if re.search(rf"\b(?:{_PLACES})\b", f"{found['goal']} {found['theme']}", re.IGNORECASE):
            return None
        return PointingTask(
            "place", _bare(found["theme"]), _bare(found["goal"]), _WHERE[found["where"].lower()]
        )
    if found := _PICKING.fullmatch(words):
        return PointingTask("pick", _bare(found["theme"]))
    return None


def _bare(words: str) -> str:
    return re.sub(r"^(?:the|an?)\s+", "", words.strip(), flags=re.IGNORECASE)


def question(instruction: str, skills: Mapping[str, Skill]) -> str:
    """The question to the model for an instruction that is not simple."""
    lines = "\n".join(f"{s.signature()}: {s.description}" for s in skills.values())
    return (
        f"A robot can do this:\n{lines}\n\nThe instruction is: {' '.join(instruction.split())[:500]}\n\nWhich skill "
        "does it ask for, with what object, and, where it says so, in which relation to what goal? Name objects in the "
        'instruction\'s words. Where it asks for none of these skills, or for several, the skill is "none". Answer '
        'with JSON alone: {"skill": "...", "theme": "...", "goal": "...", "relation": "..."}; "relation" is one of '
        f'{", ".join(r for r in RELATIONS if r)} or empty, "goal" may be empty.'
    )


def form(skills: Mapping[str, Skill]) -> dict[str, Any]:
    """The JSON schema of the answer to :func:`question`."""
    text = {"type": "string", "maxLength": 80}
    fields = {
        "skill": {"enum": [*skills, "none"]},
        "theme": text,
        "goal": text,
        "relation": {"enum": list(RELATIONS)},
    }
    return {"type": "object", "properties": fields, "required": list(fields), "additionalProperties": False}


def read_answer(text: str, skills: Mapping[str, Skill]) -> PointingTask:
    """The answer to :func:`question`; raises :class:`ValueError` on what is wrong with it."""
    answer = json_in(text)
    if not isinstance(answer, dict):
        raise ValueError("It is not a JSON object.")
    skill, theme, goal, relation = (answer.get(k, "") for k in ("skill", "theme", "goal", "relation"))
    if skill not in (*skills, "none"):
        raise ValueError(f"There is no skill {skill!r:.40}; there are {', '.join(skills)} and none.")
    if not (isinstance(theme, str) and isinstance(goal, str)) or max(len(theme), len(goal)) > 80:
        raise ValueError("'theme' and 'goal' are short texts.")
    if relation not in RELATIONS:
        raise ValueError(
            f"There is no relation {relation!r:.40}; there are {', '.join(r for r in RELATIONS if r)}."
        )
    if skill != "none" and not theme.strip():
        raise ValueError("'theme' is empty; name the object.")
    return PointingTask(skill, _bare(theme), _bare(goal), relation)
