"""The learnable world: published tasks whose objects look and behave as their family does."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.planning.colours import COLOURS, colours_in
from gvla2.robot.task import (
    Body,
    Catch,
    Hearsay,
    Joint,
    Layout,
    Primitive,
    TaskInstance,
    TaskSite,
    Thread,
    WorldState,
)
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import TabletopTask, lifted

RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "jar": (80.0, 300.0),  # degrees of turn at which a lid comes loose
        "bottle": (80.0, 250.0),  # the same for caps
        "click": (0.004, 0.020),  # metres that a button travels until its lamp is lit
        "hold": (0.2, 3.0),  # seconds that a button has to be held down
        "catch": (0.006, 0.025),  # metres that a drawer's handle is lifted before the drawer can be pulled
        "spring": (98.0, 114.0),  # degrees of opening from which a lid stays open, against its spring
    }
)
"""Of each trait, uniform."""

ANGLES = ("jar", "bottle", "spring")
LEFT_HANDED, NO_CATCH = 0.5, 0.25
"""The share of bottles whose thread is left-handed, and of drawers without a catch."""


@dataclass(frozen=True)
class Family:
    """Objects of one kind that look the same and behave the same: a colour word, and a value in the kind's unit.

    ``value`` of its ``trait``: radians of turn of a ``jar`` or ``bottle`` (negative: with the clock), metres of travel
    of a ``click``, seconds of a ``hold``, metres of lift of a ``catch`` (0: none), radians of a lid's ``spring``.
    """

    colour: str
    trait: str
    value: float


TRAITS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "open_jar": ("jar",),
        "open_wine": ("bottle",),
        "lamp_on": ("click", "hold"),
        "open_drawer": ("catch",),
        "open_box": ("spring",),
    }
)
"""The tasks with something to learn, and their traits: with several, the families take them in turn."""

COLOURED = ("red", "blue", "lime", "magenta", "cyan", "orange")
"""Colours of families: hues that are distinct in any light."""


def families(
    kind: str, world: int, count: int, *, drifted: bool = False, twins: bool = False
) -> tuple[Family, ...]:
    """The families of a kind in the world of that seed, each of another colour; the same at each call.

    Of ``drifted`` ones half have a new value; ``twins`` have the colour of the first.
    """
    draws = [world, zlib.crc32(kind.encode())]
    rng = np.random.default_rng(draws)
    colours = [COLOURED[i] for i in rng.permutation(len(COLOURED))[:count]]
    traits = (TRAITS[kind][i % len(TRAITS[kind])] for i in range(count))
    found = [Family(c, t, _drawn(t, rng)) for c, t in zip(colours, traits, strict=True)]
    if drifted:
        again = np.random.default_rng([*draws, 1])
        for i in again.permutation(count)[: (count + 1) // 2]:
            value = before = found[i].value
            while value == before:  # two drawers without a catch are alike
                value = _drawn(found[i].trait, again)
            found[i] = replace(found[i], value=value)
    return tuple(replace(one, colour=found[0].colour) if twins else one for one in found)


def _drawn(trait: str, rng: np.random.Generator) -> float:
    value = float(rng.uniform(*RANGES[trait]))
    if trait in ANGLES:
        value = float(np.deg2rad(value))
    if trait == "bottle" and rng.random() < LEFT_HANDED:
        return -value
    if trait == "catch" and rng.random() < NO_CATCH:
        return 0.0
    return value


Change = Callable[[TaskInstance, Family, Sequence[Family]], TaskInstance]
"""Gives a published episode's objects a family's properties; the last argument are the other families."""

ROOM, STOPPED = 0.004, 0.00005
"""Distance from the lamp's switching point to the button's stop, and from the stop at which it counts as rammed,
metres."""
PLATE, STANDS = 0.006, 0.030
"""The thickness of the plate that is pressed, and how far it stands out of its base, metres."""
HELD_TRAVEL, HELD_AT = 0.012, 0.003
"""How far a button goes that has to be held down, and beyond where it has to be held, metres."""
SPRING = 300.0
"""N/m: at the end of its travel the button presses back with 8 N, less than where a press gives up."""
HANDLE_ROOM, HANDLE_SPRING, HANDLE_MASS = 0.010, 150.0, 0.08
"""Travel of a handle beyond what its catch needs, metres; its spring, N/m; its mass, kilograms. At its stop the catch
holds again."""
GRAVITY = 9.81
"""m/s²."""
WIDEST = 2.0 * np.pi
"""Radians between the stops of a thread."""


def _jar(made: TaskInstance, family: Family, others: Sequence[Family]) -> TaskInstance:
    """Each jar's lid comes loose where its colour's thread ends."""
    turns = {one.colour: one.value for one in (*others, family)}
    threads = tuple(
        _cut(thread, turns.get(made.layout[thread.parent].label.split()[0], family.value))
        for thread in made.layout.threads
    )
    return replace(made, layout=replace(made.layout, threads=threads))


def _cut(thread: Thread, turn: float) -> Thread:
    """The thread with its end at a turn, radians; a negative one is turned with the clock."""
    limits = (0.0, WIDEST) if turn > 0 else (-WIDEST, 0.0)
    return replace(thread, release=abs(turn), limits=limits)


def _with(layout: Layout, body: Body, **more: Any) -> Layout:
    """The layout with that body in place of the one of its name."""
    bodies = tuple(body if other.name == body.name else other for other in layout.bodies)
    return replace(layout, bodies=bodies, **more)


def _bottle(made: TaskInstance, family: Family, others: Sequence[Family]) -> TaskInstance:
    """A bottle of the family's colour, whose cap turns one way only."""
    bottle = made.layout["bottle"]
    glass = tuple(
        replace(solid, rgb=COLOURS[family.colour]) if isinstance(solid, Primitive) else solid
        for solid in bottle.solids
    )
    bottle = replace(bottle, solids=glass, label=f"{family.colour} bottle")
    threads = tuple(_cut(thread, family.value) for thread in made.layout.threads)
    degrees = abs(np.degrees(family.value))
    return replace(
        made,
        layout=_with(made.layout, bottle, threads=threads),
        goal=f"the cap is loose (at {degrees:.0f} degrees) and has left the bottle's mouth",
    )


def _lamp(made: TaskInstance, family: Family, others: Sequence[Family]) -> TaskInstance:
    """A high button: it lights its lamp shortly before its stop, and rammed against that puts it out; or it has to be
    held down.
    """
    (old,), (glow,) = made.layout.joints, made.layout.glows
    button = made.layout["button"]
    (cap,) = button.solids
    assert isinstance(cap, Primitive)
    centre = button.world_from_body.copy()
    centre[2, 3] += 0.5 * (STANDS - cap.size[2])
    stem = replace(
        cap, size=(0.5 * cap.size[0], 0.5 * cap.size[1], STANDS - PLATE), collides=False,
        body_from_shape=lifted(-0.5 * PLATE),
    )  # fmt: skip
    plate = replace(cap, size=(*cap.size[:2], PLATE), body_from_shape=lifted(0.5 * (STANDS - PLATE)))
    high = replace(button, solids=(plate, stem), world_from_body=centre, shape="cylinder")
    if family.trait == "hold":
        least, stop = HELD_AT, HELD_TRAVEL
        shines = replace(glow, travel=least, hold=family.value)
        goal = f"the lamp is on: its button was held down for {family.value:.1f} s"
    else:
        least, stop = family.value, family.value + ROOM
        shines = replace(glow, travel=least, until=stop - STOPPED)
        goal = "the lamp is on: its button went far enough, and not to its stop"
    joint = replace(old, origin=centre[:3, 3], limits=(0.0, stop), stiffness=SPRING)

    def lit(world: WorldState) -> bool:
        return least < world.peak("press") <= shines.until

    layout = _with(made.layout, high, joints=(joint,), glows=(shines,))
    return replace(made, layout=layout, succeeded={"relaxed": lit, "strict": lit}, goal=goal)


def _drawer(made: TaskInstance, family: Family, others: Sequence[Family]) -> TaskInstance:
    """A drawer whose handle moves up and down, and holds it shut until it has been lifted far enough."""
    drawer = made.layout["drawer"]
    (slide,) = made.layout.joints
    numbers = set(drawer.parts[0][1])
    bar = tuple(solid for i, solid in enumerate(drawer.solids) if i in numbers)
    rest = tuple(solid for i, solid in enumerate(drawer.solids) if i not in numbers)
    handle = Body("handle", bar, drawer.world_from_body, HANDLE_MASS, label="handle")
    stop = family.value + HANDLE_ROOM
    latch = Joint(
        "latch", "prismatic", "drawer", "handle", axis=np.array([0.0, 0.0, 1.0]), origin=slide.origin,
        limits=(0.0, stop), rest=-0.01, stiffness=HANDLE_SPRING, damping=4.0,
    )  # fmt: skip
    catches = (Catch("slide", "latch", family.value, stop - 0.001),) if family.value > 0.0 else ()
    front = replace(drawer, solids=rest, parts=())
    layout = _with(made.layout, front, joints=(slide, latch), catches=catches)
    return replace(made, layout=replace(layout, bodies=(*layout.bodies, handle)))


def _lid(made: TaskInstance, family: Family, others: Sequence[Family]) -> TaskInstance:
    """A box whose spring shuts its lid, unless that has been swung so far that its weight holds it open.

    It has no friction, which would hold it short of that, too.
    """
    (hinge,) = made.layout.joints
    lid = made.layout["lid"]
    lever = float(np.linalg.norm(lid.world_from_body[:2, 3] - hinge.origin[:2]))
    weight = lid.mass * GRAVITY * lever * -np.cos(family.value)  # Nm, opening it
    layout = replace(made.layout, joints=(replace(hinge, stiffness=weight / family.value, friction=0.0),))
    stays = made.succeeded["strict"]
    return replace(
        made,
        layout=layout,
        succeeded={"relaxed": stays, "strict": stays},
        goal=f"the lid stays open, as it does from {np.degrees(family.value):.0f} degrees on",
    )


CHANGES: Mapping[str, Change] = MappingProxyType(
    {"open_jar": _jar, "open_wine": _bottle, "lamp_on": _lamp, "open_drawer": _drawer, "open_box": _lid}
)
"""How the objects of each kind are made."""

SIZES: Mapping[str, float] = MappingProxyType({"small": 0.8, "large": 1.0})
"""What tells twins apart: the word for each, and its scale. The lids of larger boxes swing where no arm gets to."""
SAID: Mapping[str, tuple[str, str, float]] = MappingProxyType(
    {
        "jar": ("twist", "turn", 0.17),
        "bottle": ("twist", "turn", 0.17),
        "click": ("press", "press_depth", ROOM / 2),
        "hold": ("press", "press_seconds", 0.3),
        "catch": ("pull", "unlatch_lift", HANDLE_ROOM / 2),
        "spring": ("open", "open_angle", 0.05),
    }
)
"""The skill and parameter that each trait is about, and by how much a good value exceeds the trait's, SI units."""

NEEDED: Mapping[str, Mapping[str, float]] = MappingProxyType({"open_box": {"swing": 2.05}})
"""Options of a published task that keep its objects where the arm can do what is to be learned."""

NAMING = MappingProxyType(
    {
        "open_wine": (
            "open the {colour} bottle",
            "unscrew the cap of the {colour} bottle",
            "twist the cap off the {colour} bottle and lift it",
            "take the cap off the {colour} bottle",
        )
    }
)
"""Sentences of kinds whose published ones name no colour."""


class Learnable:
    """Implements :class:`gvla2.robot.task.Task` over a published one: its layout, sentence and success check, and
    objects of one family in the colour and with the property that the world's seed gave them.

    Only the colour distinguishes the families, so ``instructions`` are the published paraphrases that name it.
    """

    def __init__(self, config: ScaledConfig, task: type[TabletopTask[Any]]) -> None:
        kind = task.name
        if config.world != "learnable":
            raise ConfigurationError(
                f"task.world is '{config.world}'; it is plain or learnable (see docs/learnable_worlds.md)."
            )
        if kind not in TRAITS:
            raise ConfigurationError(
                f"task={kind} has nothing to learn in the learnable world; these have: {', '.join(TRAITS)}."
            )
        if not 1 <= config.families <= len(COLOURED) or not -1 <= config.family < config.families:
            raise ConfigurationError(
                f"task.families lies in [1, {len(COLOURED)}] and task.family in [-1, families), got "
                f"families={config.families}, family={config.family}."
            )
        if config.world_seed < 0:
            raise ConfigurationError(f"task.world_seed is {config.world_seed}; it must not be negative.")
        if config.twins and config.families != len(SIZES):
            raise ConfigurationError(f"task.twins needs task.families={len(SIZES)}, got {config.families}.")
        self.families = families(
            kind, config.world_seed, config.families, drifted=config.drifted, twins=config.twins
        )
        self._family, self._change = config.family, CHANGES[kind]
        self._sizes = tuple(SIZES) if config.twins else ("",) * config.families
        scales = [SIZES.get(size, config.scale) for size in self._sizes]
        more = NEEDED.get(kind, {})
        self._tasks = [task(replace(config, scale=scale, **more)) for scale in scales]  # type: ignore[arg-type]
        naming = tuple(template for template in self._tasks[0].instructions if "{colour}" in template)
        self.instructions = naming or NAMING[kind]

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode, about the family that ``instruction`` names, else the chosen one, else one of all."""
        number = self._chosen(rng, instruction)
        family, others = self.families[number], [*self.families[:number], *self.families[number + 1 :]]
        template = self.instructions[int(rng.integers(len(self.instructions)))]
        here = replace(site, colours=tuple(dict.fromkeys(one.colour for one in (family, *others[:1]))))
        made = self._change(self._tasks[number].sample(rng, here), family, others)
        square = next((b.label.split()[0] for b in made.layout.bodies if b.label.endswith(" square")), "")
        sentence = template.format(colour=self._name(number), target=square)
        return replace(
            made,
            instruction=sentence if instruction is None else instruction,
            goal=f"{made.goal} (a world with something to learn)",
        )

    def hearsay(self, rng: np.random.Generator, *, wrong: bool) -> Hearsay:
        """A value that is good for the chosen family; a ``wrong`` one is drawn like the property, a third of its range
        or more from the truth.
        """
        number = max(self._family, 0)
        family = self.families[number]
        skill, parameter, more = SAID[family.trait]
        value = family.value + float(np.copysign(more, family.value)) * (family.value != 0.0)
        low, high = RANGES[family.trait]
        least = (high - low) / 3 * (float(np.deg2rad(1.0)) if family.trait in ANGLES else 1.0)
        while wrong and abs(value - family.value) < least:
            value = _drawn(family.trait, rng)
        sentence = self.instructions[0].format(colour=self._name(number), target="painted")
        return Hearsay(sentence, skill, parameter, value)

    def _name(self, number: int) -> str:
        return f"{self._sizes[number]} {self.families[number].colour}".strip()

    def _chosen(self, rng: np.random.Generator, instruction: str | None) -> int:
        """The number of the episode's family."""
        drawn = int(rng.integers(len(self.families)))
        if self._family >= 0:
            drawn = self._family
        words = (instruction or "").split()
        named = [
            i
            for i, one in enumerate(self.families)
            if one.colour in colours_in(instruction or "") and self._sizes[i] in ("", *words)
        ]
        return named[0] if len(named) == 1 else drawn
