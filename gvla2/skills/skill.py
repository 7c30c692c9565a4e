"""What a skill is: its roles, its parameters and how it is carried out. For standard and third-party skills."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from gvla2.planning.arm import Hand
    from gvla2.planning.calls import SkillOptions
    from gvla2.planning.contracts import Abstention
    from gvla2.planning.scene import Scene, SceneObject
    from gvla2.skills.diagnosis import Outcome, Signal
    from gvla2.skills.proposals import Job, Proposal

RoleName = Literal["theme", "goal", "part"]


@dataclass(frozen=True)
class Role:
    """The role of an object: ``theme`` is the object that is handled, ``goal`` is where it goes.

    ``part`` is for plans only: the part of the theme that was used.

    ``relations`` are those that the skill supports for its goal, the default one first. A place or a direction can take
    the place of a ``required`` goal if the skill allows it.
    """

    name: RoleName
    meaning: str
    required: bool = True
    relations: tuple[str, ...] = ()


@dataclass(frozen=True)
class Parameter:
    """One parameter of a skill: its unit ("m", "rad", "s", "m/s", "" for a share), meaning and sensible range."""

    name: str
    unit: str
    meaning: str
    least: float = 0.0
    most: float = 1.0


@dataclass(frozen=True)
class Example:
    """A worked example for prompts: ``objects`` as :func:`~gvla2.planning.scene_brief.scene_brief` lists them, an
    ``instruction`` and the ``call`` that carries it out.
    """

    objects: str
    instruction: str
    call: str


@dataclass(frozen=True)
class Skill:
    """An action of the hand, called by planners and learnt about by memory.

    ``description`` is one line for prompts and docs. ``propose`` turns a :class:`~gvla2.skills.proposals.Job` into
    proposed trajectories, or says why there are none; ``defaults`` gives theta without memory, for the theme, the hand
    and the options. ``roles`` always has a ``theme``.

    ``amount`` names the parameter that a call's amount sets, "" if the skill takes none. ``free`` skills can go to a
    place (x, y) or in a direction instead of to a goal. ``whole``: the skill applies only to whole objects, so that a
    named part means its whole. ``words`` is the skill's name in lessons ("Pick up (grasp, lift)"), so that other
    wordings of an instruction find them; ``key`` are the most important parameters, which successes teach; ``scaled``
    names those that scale with a side of the theme ("height"). ``held_back``: the moved object may resist, so that a
    slip is due to theta. ``lasting`` are the parameters whose effect stays after a failed attempt. ``diagnose``
    finds what went wrong in an outcome, and what to change. ``fits`` is whether the skill applies to an object at all
    (None: to any), and ``examples`` show a language model how it is called. ``implied`` skills are left out of prompts:
    others turn into them if the scene requires it.
    """

    name: str
    description: str
    roles: Sequence[Role]
    parameters: Sequence[Parameter]
    propose: Callable[[Job], Sequence[Proposal] | Abstention]
    defaults: Callable[[SceneObject, Hand, SkillOptions], Mapping[str, float]]
    words: str = ""
    key: Sequence[str] = ()
    scaled: Mapping[str, str] = field(default_factory=dict)
    amount: str = ""
    free: bool = False
    whole: bool = False
    held_back: bool = False
    lasting: Sequence[str] = ()
    diagnose: Callable[[Outcome], Signal | None] | None = None
    fits: Callable[[SceneObject, Scene, Hand], bool] | None = None
    examples: Sequence[Example] = ()
    implied: bool = False

    def role(self, name: RoleName) -> Role | None:
        """The role of that name; None if the skill has none."""
        return next((r for r in self.roles if r.name == name), None)

    @property
    def aimed(self) -> bool:
        """Whether a call must say where the theme goes: a goal, a place or a direction."""
        goal = self.role("goal")
        return goal is not None and goal.required

    def signature(self, *, brief: bool = False) -> str:
        """How it is called: ``place(theme, goal | xy | direction, relation=on|in|...)``; ``brief`` for small models:
        ``place(theme, goal, on|in|...)``.
        """
        goal = self.role("goal")
        words = ["theme"]
        if goal is not None:
            where = "goal" + (" | xy | direction" if self.free and not brief else "")
            words.append(where if goal.required else f"[{where}]")
            if brief and goal.required and len(goal.relations) > 3:
                words.append("|".join(r for r in goal.relations if r != "to"))
            elif not brief and len(goal.relations) > 1:
                words.append(f"relation={'|'.join(goal.relations)}")
        if self.amount and not brief:
            words.append("amount=")
        return f"{self.name}({', '.join(words)})"


def fault_of(offered: object) -> str:
    """Why a plugin's offer, of any type, is no skill that a program can call; "" if it is one."""
    if not isinstance(offered, Skill):
        return f"returned {offered!r:.200}, which is not a Skill."
    name: Any = offered.name
    if not isinstance(name, str) or not name.isidentifier() or name != name.lower():
        return f"the name {name!r:.200} cannot be called in a program; use small letters, digits and '_'."
    for what, value, kind in (("role", offered.roles, Role), ("parameter", offered.parameters, Parameter)):
        if not isinstance(value, Sequence) or not all(isinstance(v, kind) for v in value):
            return f"'{name}' has {what}s that are not a sequence of {kind.__name__}: {value!r:.200}."
    if offered.role("theme") is None:
        return f"'{name}' has no role 'theme': every skill handles something."
    for what in ("propose", "defaults"):
        if not callable(getattr(offered, what)):
            return f"'{name}' has a {what} that cannot be called."
    known = {p.name for p in offered.parameters}
    strange = [
        n for n in (*offered.key, *offered.scaled, *offered.lasting, offered.amount) if n and n not in known
    ]
    if strange:
        return f"'{name}' refers to '{strange[0]}', which is not among its parameters: {', '.join(known) or 'none'}."
    if not offered.description:
        return f"'{name}' has no description, which is how planners learn of it."
    return ""
