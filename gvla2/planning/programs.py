"""Programs: what a planner meant in its own language, kept of a success and told again with other names.

Names of objects become roles (``theme``, ``goal``, ``third``), so that a program holds for other objects of the same
kind; sizes become shares of the handled object's height where the planner wrote them so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from gvla2.errors import PlanningError

Language = Literal["calls", "waypoints"]


@dataclass(frozen=True)
class Program:
    """``steps`` in a ``language``, with role names in braces where objects are meant.

    ``calls``: a step is a line, ``place({theme}, {goal}, in)``. ``waypoints``: a step is
    ``["{theme}", dx, dy, height, g]``, millimetres from the object's centre and above its top, or as the planner that
    wrote it says. ``roles`` are the kinds of things that the names stood for ("cup cylinder"), ``instruction`` what it
    was written for.
    """

    language: Language
    steps: tuple[Any, ...]
    roles: Mapping[str, str] = field(default_factory=dict)
    skill: str = ""
    instruction: str = ""
    source: str = ""

    def to_json(self) -> dict[str, Any]:
        """As the effect of a lesson, see :class:`gvla2.memory.contracts.Lesson`."""
        return {
            "kind": "program",
            "skill": self.skill,
            "language": self.language,
            "instruction": self.instruction,
            "roles": dict(self.roles),
            "steps": list(self.steps),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any], source: str = "") -> Program:
        """What :meth:`to_json` wrote; raises :class:`PlanningError` for anything else."""
        steps, roles = data.get("steps"), data.get("roles", {})
        sound = isinstance(steps, list | tuple) and isinstance(roles, Mapping) and len(steps) <= 40
        # Forty steps are more than any plan of the loop can hold.
        if data.get("kind") != "program" or data.get("language") not in ("calls", "waypoints") or not sound:
            raise PlanningError(f"Not a program: {dict(data)!r:.200}.")
        return cls(
            data["language"],
            tuple(steps or ()),
            {str(k): str(v) for k, v in roles.items()},
            str(data.get("skill", "")),
            str(data.get("instruction", "")),
            source,
        )
