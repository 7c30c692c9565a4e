"""What a skill is: roles, parameters, how it is carried out and diagnosed. For standard and third-party skills."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from gvla2.planning.calls import GraspOptions, SkillOptions

if TYPE_CHECKING:  # `gvla2 plugins` lists skills without numpy
    from gvla2.geometry.transform import FloatArray
    from gvla2.planning.arm import Hand
    from gvla2.planning.effects import Bound, Effect
    from gvla2.planning.plan import Abstention, Plan
    from gvla2.planning.scene import Box, Scene, SceneObject
    from gvla2.planning.trajectory import Trajectory, Waypoint

TABLE_GAP = 0.004
"""Least height of the fingertips above the table, metres: about twice a depth camera's error."""
ON_WAY = 0.03
"""Gap within which an object beside what is carried is on its way, metres."""
NEIGHBOURS = 0.002
"""Objects nearer than this to the theme may touch it, metres."""
EMPTY = 0.001
"""Fingers this close hold nothing, metres."""

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
class Job:
    """One grounded request. ``goal`` is the object that the theme goes to, or None, and ``relation`` how it should lie
    there; ``target`` (2,) is the intended position of the theme's centre, world metres, in the goal if there is one.
    ``share``: the theme is the k-th (from 0) of n objects that go there. ``done`` is the amount by parameter that
    earlier attempts did to the theme. ``grasp`` is how grasps are chosen.
    """

    skill: str
    scene: Scene
    hand: Hand
    workspace: Box
    theta: Mapping[str, float]
    theme: SceneObject
    goal: SceneObject | None = None
    relation: str = ""
    target: FloatArray | None = None
    share: tuple[int, int] = (0, 1)
    done: Mapping[str, float] = field(default_factory=dict)
    grasp: GraspOptions = field(default_factory=GraspOptions)

    @cached_property
    def rise(self) -> float:
        """Height by which the theme must be lifted to leave what it stands in, metres."""
        from gvla2.planning.part_hierarchy import rise

        return rise(self.theme, self.scene)

    @cached_property
    def way_out(self) -> FloatArray:
        """(3,) unit: the direction in which the theme leaves what it stands in."""
        from gvla2.planning.part_hierarchy import way_out

        return way_out(self.theme, self.scene)

    def highest(self, spot: FloatArray) -> float:
        """Height of the highest object on the way to a spot (3,), except the theme and its parts, or of the table,
        metres.
        """
        start, way = self.theme.centre[:2], spot[:2] - self.theme.centre[:2]
        aside = 0.5 * float(max(self.theme.extents[:2].max(), self.hand.palm_breadth)) + ON_WAY
        found = [self.scene.table_height]
        for obj in self.scene.obstacles(self.own):
            along = float((obj.centre[:2] - start) @ way) / max(float(way @ way), 1e-9)
            nearest = start + min(1.0, max(0.0, along)) * way
            ends = [*start, obj.centre[2]], [*nearest, obj.centre[2]], [*spot[:2], obj.centre[2]]
            if float(obj.distances(ends).min()) < aside:
                found.append(obj.top)
        return max(found)

    # Cached: dozens of proposals ask for the same.
    @cached_property
    def own(self) -> frozenset[str]:
        """Ids of the theme and its parts, which a hand that grasps it may touch."""
        return self.scene.family(self.theme.id)

    @cached_property
    def resting(self) -> frozenset[str]:
        """Ids of what the theme stands in or on, with their parts, and the table: it touches them before the lift."""
        from gvla2.planning.part_hierarchy import holders

        held = [self.scene.family(holder.id) for holder in holders(self.theme, self.scene)]
        outline = self.theme.outline()
        touching = {
            o.id for o in self.scene.obstacles(self.own) if float(o.distances(outline).min()) < NEIGHBOURS
        }
        return frozenset({"table"} | touching).union(*held)

    @cached_property
    def around(self) -> frozenset[str]:
        """Ids of what the theme lies deep in: solids that hand and theme are inside of as the checks see them."""
        from gvla2.planning.part_hierarchy import holders

        deep = [h for h in holders(self.theme, self.scene) if h.top >= self.theme.top]
        return frozenset[str]().union(*(self.scene.family(holder.id) for holder in deep))

    def lowest_tcp(self) -> float:
        """The lowest height of the tool, pointing down, with the fingertips above the table, metres."""
        return self.scene.table_height + TABLE_GAP + self.hand.tip_beyond_tcp

    def foot(self) -> tuple[float, float]:
        """(x, y) of the arm's foot, at the middle of the workspace's near side, metres."""
        low, high = self.workspace.low, self.workspace.high
        return float(low[0]), float(0.5 * (low[1] + high[1]))

    def outward(self) -> FloatArray:
        """(3,) level vector from the arm's foot to the theme."""
        outward = self.theme.centre
        outward[:2] -= self.foot()
        outward[2] = 0.0
        return outward

    def ceiling(self) -> float:
        """The greatest height of the tool, metres."""
        return float(min(self.workspace.high[2], self.scene.workspace.high[2]))


@dataclass(frozen=True)
class Proposal:
    """One way to do a job. ``approaches`` are the names by which memory may forbid it ("approach:top");
    ``preference`` in [0, 1] rates its geometry, without regard to the arm. Proposals in ``reserve`` are considered only
    if all others failed. ``way`` is the trajectory, or a function that writes it: only a few of dozens are needed.
    """

    description: str
    approaches: tuple[str, ...]
    preference: float
    way: Trajectory | Callable[[], Trajectory]
    notes: tuple[str, ...] = ()
    reserve: bool = False

    @cached_property
    def trajectory(self) -> Trajectory:
        """The trajectory, written on first use."""
        if callable(self.way):
            made: Trajectory = self.way()
            return made
        return self.way


@dataclass(frozen=True)
class Signal:
    """One diagnosed cause: a stable ``kind``, ``words`` that are true of any such episode, and its effect, if any."""

    kind: str
    words: str
    effect: Effect | None = None


@dataclass(frozen=True)
class Reached:
    """One executed waypoint: its ``stage``, the fingers' gap at its end in metres, whether a guard ended it, and the
    tool's distance from its target, metres.
    """

    index: int
    stage: str
    gripper_width: float
    guarded: bool = False
    error: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """A plan that was executed to its end, or until the object ``slipped`` or resisted.

    ``theme`` is the handled object as perceived ``before``; ``later(id)`` is an object as perceived afterwards, None if
    it was not found; ``after`` is the whole scene perceived then.
    """

    plan: Plan
    before: Scene
    theme: SceneObject
    later: Callable[[str], SceneObject | None]
    reached: tuple[Reached, ...] = ()
    slipped: bool = False
    after: Scene | None = None

    @property
    def goal(self) -> SceneObject | None:
        """The plan's goal, as perceived before; None if it has none."""
        return next((o for o in self.before.objects if o.id == self.plan.roles.get("goal")), None)

    @property
    def waypoints(self) -> tuple[Waypoint, ...]:
        """The plan's waypoints; () if it has no trajectory."""
        return self.plan.trajectory.waypoints if self.plan.trajectory else ()

    def gripped(self) -> bool:
        """Whether the fingers held something wherever the plan carries it."""
        carrying = [r.gripper_width for r, w in self._followed() if w.carries and w.gripper < 0.1]
        return bool(carrying) and min(carrying) > EMPTY

    def held_back(self) -> bool:
        """Whether the hand closed on something and began to carry it, so that the object must have resisted."""
        closed = any(r.stage == "close" and r.gripper_width > EMPTY for r in self.reached)
        return closed and any(w.carries for _, w in self._followed())

    def _followed(self) -> list[tuple[Reached, Waypoint]]:
        return [(r, self.waypoints[r.index]) for r in self.reached if r.index < len(self.waypoints)]

    def stopped(self, stage: str, short: float) -> bool:
        """Whether a guard ended a motion of this stage, or it ended more than ``short`` metres off its target."""
        return any(r.guarded or r.error > short for r in self.reached if r.stage == stage)

    def went(self, stage: str, name: str) -> float:
        """The value of a parameter that the motions of this stage reached, metres."""
        missed = max((r.error for r in self.reached if r.stage == stage), default=0.0)
        return self.plan.parameters.get(name, 0.0) - missed

    def changed(self, name: str, by: float, op: str = ">=") -> Bound | None:
        """The bound at ``by`` more (or less) than the used value of a parameter; None if the parameter was not used."""
        from gvla2.planning.effects import Bound

        used = self.plan.parameters.get(name)
        if used is None:
            return None
        return Bound(name, used + by, "<=" if op == "<=" else ">=", skill=self.plan.skill)


@dataclass(frozen=True)
class Skill:
    """An action of the hand, called by planners; memory learns about it.

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
    (None: to any). ``implied`` skills are left out of prompts:
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
    if not all(map(callable, (offered.propose, offered.defaults))):
        return f"'{name}' has a propose or defaults that cannot be called."
    known = {p.name for p in offered.parameters}
    used = {*offered.key, *offered.scaled, *offered.lasting, offered.amount} - {"", *known}
    if used:
        return f"'{name}' refers to {', '.join(map(repr, used))}; its parameters are {', '.join(known) or 'none'}."
    return "" if offered.description else f"'{name}' has no description, by which planners choose skills."
