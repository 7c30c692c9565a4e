"""Tasks: what is on the table, what is asked, and when it counts as done."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from gvla2.errors import ConformanceError, PluginError
from gvla2.geometry.exchange import require, require_rigid, require_type
from gvla2.geometry.transform import FloatArray
from gvla2.robot.scan import Scan


def _identity() -> FloatArray:
    return np.eye(4)


@dataclass(frozen=True)
class Primitive:
    """One solid of a body. ``size``: box (x, y, z) full lengths; cylinder (diameter, diameter, height) about z;
    sphere (diameter,) * 3; metres. ``body_from_shape`` (4, 4); ``rgb`` in [0, 1]; ``collides`` False for paint.
    """

    kind: Literal["box", "cylinder", "sphere"]
    size: tuple[float, float, float]
    rgb: tuple[float, float, float]
    body_from_shape: FloatArray = field(default_factory=_identity)
    collides: bool = True


Solid = Primitive | Scan
"""A body's solids: simple shapes, meshes, or both."""


@dataclass(frozen=True)
class Body:
    """A rigid body. ``world_from_body`` (4, 4) at reset; ``mass`` in kg (of all its solids); ``fixed`` to the world.

    ``label`` is its everyday name ("red cup") and ``shape`` the overall shape of a body of several solids (see
    :data:`gvla2.planning.scene.Shape`); ``parts`` are labels, by solid number, of solids with their own name
    ("handle"). Only a scene made from true state reads them.
    """

    name: str
    solids: tuple[Solid, ...]
    world_from_body: FloatArray
    mass: float = 0.1
    fixed: bool = False
    friction: float = 0.8
    label: str = ""
    shape: str = ""
    parts: tuple[tuple[str, tuple[int, ...]], ...] = ()


@dataclass(frozen=True)
class Joint:
    """A sprung joint between two bodies, both given at their pose of zero travel.

    ``axis`` (3,) unit, world frame at reset; ``origin`` (3,) a point on it, world; ``limits`` and ``rest`` in
    radians or metres; ``stiffness`` N/m or Nm/rad to ``rest``; ``damping``, ``friction`` likewise.
    """

    name: str
    kind: Literal["revolute", "prismatic"]
    parent: str
    child: str
    axis: FloatArray
    origin: FloatArray
    limits: tuple[float, float]
    rest: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True)
class Thread:
    """A screwed body: ``child`` can only turn about ``axis``, and comes loose once it has been turned far enough.

    ``axis`` (3,) unit and ``origin`` (3,), world frame at reset; a positive turn is the right hand's. ``limits`` are
    the turns that the thread allows and ``release`` the turn, either way, at which it comes loose; radians, less than a
    whole turn. ``damping`` in Nms/rad is its resistance. Both bodies carry no :class:`Joint`.
    """

    name: str
    parent: str
    child: str
    axis: FloatArray
    origin: FloatArray
    release: float
    limits: tuple[float, float]
    damping: float = 0.02


@dataclass(frozen=True)
class Catch:
    """A catch: the joint ``joint`` moves by no more than ``play`` unless the joint ``key`` is at ``travel`` or beyond,
    and no further than ``until``.

    Once it has moved it stays free. All in the joints' own units, metres or radians.
    """

    joint: str
    key: str
    travel: float
    until: float = float("inf")
    play: float = 0.001


@dataclass(frozen=True)
class Glow:
    """A lamp: solid number ``solid`` of ``body`` takes the colour ``rgb`` once the joint has travelled beyond
    ``travel``.

    It stays lit, unless the joint has travelled beyond ``until`` as well; with that given, each stroke of the joint
    from rest counts separately, also in its ``peak``. Both in the joint's unit, radians or metres. With ``hold``
    seconds the joint has to stay beyond ``travel`` that long: until then its ``peak`` is at most ``travel``.
    """

    body: str
    solid: int
    joint: str
    travel: float
    rgb: tuple[float, float, float]
    until: float = float("inf")
    hold: float = 0.0


@dataclass(frozen=True)
class Layout:
    """All bodies, joints, threads and catches of one episode, besides the table and the robot, and the lamps."""

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...] = ()
    glows: tuple[Glow, ...] = ()
    threads: tuple[Thread, ...] = ()
    catches: tuple[Catch, ...] = ()

    def __getitem__(self, name: str) -> Body:
        for body in self.bodies:
            if body.name == name:
                return body
        raise KeyError(f"No body '{name}' in the layout; it has {[b.name for b in self.bodies]}.")

    def lights(self, peaks: Mapping[str, float]) -> tuple[bool, ...]:
        """Which of the glows are lit for the joints' largest travels, by name, ``peaks``."""
        return tuple(glow.travel < peaks[glow.joint] <= glow.until for glow in self.glows)

    def lit(self, peaks: Mapping[str, float]) -> tuple[Body, ...]:
        """The bodies as they then look."""
        bodies = {body.name: body for body in self.bodies}
        for glow, on in zip(self.glows, self.lights(peaks), strict=True):
            solids = list(bodies[glow.body].solids)
            solid = solids[glow.solid]
            if on and isinstance(solid, Primitive):
                solids[glow.solid] = replace(solid, rgb=glow.rgb)
                bodies[glow.body] = replace(bodies[glow.body], solids=tuple(solids))
        return tuple(bodies.values())


class WorldState(Protocol):
    """True poses, which only a success check may read. No stage between ``observe`` and ``learn`` ever sees it."""

    def pose(self, body: str) -> FloatArray:
        """world_from_body (4, 4) now."""
        ...

    def joint(self, name: str) -> float:
        """Travel of a joint, or turn of a thread, now; radians or metres."""
        ...

    def peak(self, name: str) -> float:
        """Largest travel of a joint, or largest turn of a thread either way, since the reset."""
        ...

    def held(self, body: str) -> bool:
        """Whether both fingers press on the body now."""
        ...

    def touching(self, body: str) -> frozenset[str]:
        """Names of the bodies that press on the body now; "table" and "robot" are among them."""
        ...

    def resting(self, body: str) -> bool:
        """Whether the body lies still now and the robot does not touch it: it has been released."""
        ...

    def loose(self, thread: str) -> bool:
        """Whether a thread has come loose."""
        ...


Profile = Literal["relaxed", "strict"]


@dataclass(frozen=True)
class TaskInstance:
    """One sampled episode: the sentence, and in our own simulations the layout and the success checks.

    ``succeeded`` has a predicate for each success profile; a single one counts for both. A robot with a world of its
    own leaves both empty and answers ``success_check`` itself. ``goal`` is the criterion in words, for the run's page.
    ``image_size`` is the least image side in pixels that shows what matters, 0 for any.
    """

    instruction: str
    layout: Layout = Layout(())
    succeeded: Mapping[Profile, Callable[[WorldState], bool]] = field(default_factory=dict)
    goal: str = ""
    image_size: int = 0


@dataclass(frozen=True)
class TaskSite:
    """Where a task may be laid out, metres, world frame.

    Rectangle of ``size`` (x, y) about ``centre`` (x, y) on a table top at ``table_height``; ``reachable`` says whether
    the hand, pointing down, gets to a world point (3,). ``table_rgb`` in [0, 1] is the table's colour, so that nothing
    is painted like it; None if unknown. ``follows`` says whether the arm alone can move the tool on straight lines
    through world poses (4, 4), for tasks whose motion is prescribed. ``span`` is how far the fingers open, metres:
    objects to grasp must be smaller. ``colours`` are required colour words of the task's first objects, in the
    task's own order.
    """

    centre: tuple[float, float]
    size: tuple[float, float]
    table_height: float
    reachable: Callable[[FloatArray], bool]
    table_rgb: tuple[float, float, float] | None = None
    follows: Callable[[Sequence[FloatArray]], bool] = lambda poses: True
    span: float = 0.08
    colours: tuple[str, ...] = ()

    def inside(self, xy: FloatArray, radius: float) -> bool:
        """Whether a disc about ``xy`` (2,) lies in the rectangle."""
        off = np.abs(np.asarray(xy) - np.asarray(self.centre))
        return bool((off + radius <= 0.5 * np.asarray(self.size)).all())

    def in_reach(self, xy: FloatArray, *heights: float) -> bool:
        """Whether the hand, pointing down, gets to ``xy`` (2,) at all ``heights`` above the table, metres."""
        top_first = sorted(heights, reverse=True)  # most likely out of reach, so checked first
        return all(self.reachable(np.array([xy[0], xy[1], self.table_height + h])) for h in top_first)


class Task(Protocol):
    """A task is a recipe for episodes; a plugin offers it under a name."""

    @property
    def instructions(self) -> tuple[str, ...]:
        """At least four paraphrases; ``{colour}`` stands for the sampled colour word, if any."""
        ...

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode. With ``instruction`` the layout stays that of the seed, the sentence is the given one, and the
        success check applies to the objects that it names, if it names any (a colour on the table).
        """
        ...


@dataclass(frozen=True)
class Hearsay:
    """What somebody says about a task: to carry out ``sentence``, the ``skill``'s ``parameter`` has to be ``value``."""

    sentence: str
    skill: str
    parameter: str
    value: float


@runtime_checkable
class HasHearsay(Protocol):
    """A task about whose hidden property others talk, rightly or wrongly."""

    def hearsay(self, rng: np.random.Generator, *, wrong: bool) -> Hearsay:
        """What is said, by someone who knows or by someone who is ``wrong``."""
        ...


class CheckedTask:
    """Implements :class:`gvla2.robot.task.Task` by another; ``who`` begins the sentences about that one."""

    def __init__(self, task: Task, who: str) -> None:
        self.__wrapped__, self._who, self.instructions = task, who, task.instructions

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """The task's episode; raises :class:`PluginError` for one that cannot be laid out."""
        made = self.__wrapped__.sample(rng, site, instruction)
        try:
            check_instance(made)
            require(instruction is not None or made.instruction.strip(), "Its instruction is empty.")
        except ConformanceError as error:
            raise PluginError(f"{self._who} gave no valid episode. {error}") from error
        return made


def check_instance(instance: object) -> None:
    """Whether an episode can be laid out, asked and checked; raises :class:`ConformanceError` with what is wrong."""
    require_type(instance, TaskInstance, "sample()'s answer")
    assert isinstance(instance, TaskInstance)
    layout = instance.layout
    require_type(layout, Layout, "The layout")
    require_type(instance.instruction, str, "The instruction")
    names = [body.name for body in layout.bodies]
    require(all(names) and len(set(names)) == len(names), f"Bodies need unique names, got {names}.")
    for body in layout.bodies:
        _check_body(body)
    ties: list[Joint | Thread] = [*layout.joints, *layout.threads]
    for tie in ties:
        known = {tie.parent, tie.child} <= set(names)
        require(known, f"'{tie.name}' ties '{tie.parent}' to '{tie.child}'; the bodies are {names}.")
        require(tie.limits[0] < tie.limits[1], f"'{tie.name}': its limits {tie.limits} are not a range.")
    children = [tie.child for tie in ties]
    require(len(set(children)) == len(children), f"A body hangs on two joints: {sorted(children)}.")
    require(
        set(instance.succeeded) <= {"relaxed", "strict"} and all(map(callable, instance.succeeded.values())),
        f"The success profiles are 'relaxed' and 'strict', each a function, got {instance.succeeded!r:.200}.",
    )


def _check_body(body: Body) -> None:
    what = f"Body '{body.name}'"
    require_rigid(body.world_from_body, f"{what}: world_from_body")
    require(body.solids, f"{what} has no solids.")
    require(body.fixed or body.mass > 0, f"{what} can move, so its mass must be positive.")
    for solid in body.solids:
        require_type(solid, (Primitive, Scan), f"{what}: a solid")
        known = solid.kind in ("box", "cylinder", "sphere", "mesh")
        require(known, f"{what}: a solid is a '{solid.kind}'; there are box, cylinder, sphere and Scan.")
        sound = len(solid.size) == 3 and min(solid.size) > 0 and np.isfinite(solid.size).all()
        require(sound, f"{what}: a solid of size {solid.size}.")
        require(all(0 <= c <= 1 for c in solid.rgb), f"{what}: the colour {solid.rgb} leaves [0, 1].")
        require_rigid(solid.body_from_shape, f"{what}: body_from_shape")
