"""Making a family's things from published ones: their looks, and the hidden property."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS
from gvla2.robot.task import (
    Body,
    Catch,
    Joint,
    Primitive,
    Task,
    TaskInstance,
    TaskSite,
    Thread,
    WorldState,
)
from gvla2_plugins.tabletop.learnable_ranges import Family

Change = Callable[[Task, np.random.Generator, TaskSite, Family, Sequence[Family]], TaskInstance]

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
"""A handle goes up so much further than its catch needs, metres, against so many N/m; kilograms. At its stop the catch
holds again."""
GRAVITY = 9.81
"""m/s²."""
WIDEST = 2.0 * np.pi
"""Radians between the stops of a thread."""


def _jar(
    task: Task, rng: np.random.Generator, site: TaskSite, family: Family, others: Sequence[Family]
) -> TaskInstance:
    """Each jar's lid comes loose where its colour's thread ends."""
    made = task.sample(rng, site)
    turns = {one.colour: one.value for one in (family, *others)}
    threads = tuple(
        _cut(thread, turns.get(made.layout[thread.parent].label.split()[0], family.value))
        for thread in made.layout.threads
    )
    return replace(made, layout=replace(made.layout, threads=threads))


def _cut(thread: Thread, turn: float) -> Thread:
    """The thread with its end at a turn, radians; a negative one is turned with the clock."""
    limits = (0.0, WIDEST) if turn > 0 else (-WIDEST, 0.0)
    return replace(thread, release=abs(turn), limits=limits)


def _bottle(
    task: Task, rng: np.random.Generator, site: TaskSite, family: Family, others: Sequence[Family]
) -> TaskInstance:
    """A bottle of the family's colour, whose cap turns one way only."""
    del others
    made = task.sample(rng, site)
    glass = COLOURS[family.colour]
    bodies = tuple(
        replace(
            body,
            solids=tuple(
                replace(solid, rgb=glass) if isinstance(solid, Primitive) else solid for solid in body.solids
            ),
            label=f"{family.colour} bottle",
        )
        if body.name == "bottle"
        else body
        for body in made.layout.bodies
    )
    threads = tuple(_cut(thread, family.value) for thread in made.layout.threads)
    return replace(
        made,
        layout=replace(made.layout, bodies=bodies, threads=threads),
        goal=f"the cap is loose (at {abs(np.degrees(family.value)):.0f} degrees) and has left the bottle's mouth",
    )


def _lamp(
    task: Task, rng: np.random.Generator, site: TaskSite, family: Family, others: Sequence[Family]
) -> TaskInstance:
    """A high button: it lights its lamp shortly before its stop, and rammed against that puts it out; or it wants to be
    held down.
    """
    del others
    made = task.sample(rng, site)
    (old,), (glow,) = made.layout.joints, made.layout.glows
    button = made.layout["button"]
    (cap,) = button.solids
    assert isinstance(cap, Primitive)
    base = float(button.world_from_body[2, 3] - 0.5 * cap.size[2])
    centre = button.world_from_body.copy()
    centre[2, 3] = base + 0.5 * STANDS
    stem = replace(cap, size=(0.5 * cap.size[0], 0.5 * cap.size[1], STANDS - PLATE), collides=False)
    plate = replace(cap, size=(*cap.size[:2], PLATE), body_from_shape=_up(0.5 * (STANDS - PLATE)))
    stem = replace(stem, body_from_shape=_up(-0.5 * PLATE))
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
    bodies = tuple(high if body.name == "button" else body for body in made.layout.bodies)
    layout = replace(made.layout, bodies=bodies, joints=(joint,), glows=(shines,))

    def lit(world: WorldState) -> bool:
        return least < world.peak("press") <= shines.until

    return replace(made, layout=layout, succeeded={"relaxed": lit, "strict": lit}, goal=goal)


def _up(z: float) -> FloatArray:
    return rigid(translation=(0.0, 0.0, z))


def _drawer(
    task: Task, rng: np.random.Generator, site: TaskSite, family: Family, others: Sequence[Family]
) -> TaskInstance:
    """A drawer whose handle moves up and down, and holds it shut until it has been lifted far enough."""
    del others
    made = task.sample(rng, site)
    drawer = made.layout["drawer"]
    (slide,) = made.layout.joints
    numbers = set(drawer.parts[0][1])
    handle = Body(
        "handle",
        tuple(solid for i, solid in enumerate(drawer.solids) if i in numbers),
        drawer.world_from_body,
        HANDLE_MASS,
        label="handle",
    )
    front = replace(
        drawer, solids=tuple(s for i, s in enumerate(drawer.solids) if i not in numbers), parts=()
    )
    stop = family.value + HANDLE_ROOM
    latch = Joint(
        "latch", "prismatic", "drawer", "handle", axis=np.array([0.0, 0.0, 1.0]), origin=slide.origin,
        limits=(0.0, stop), rest=-0.01, stiffness=HANDLE_SPRING, damping=4.0,
    )  # fmt: skip
    bodies = (*(front if body.name == "drawer" else body for body in made.layout.bodies), handle)
    catches = (Catch("slide", "latch", family.value, stop - 0.001),) if family.value > 0.0 else ()
    layout = replace(made.layout, bodies=bodies, joints=(slide, latch), catches=catches)
    return replace(made, layout=layout)


def _lid(
    task: Task, rng: np.random.Generator, site: TaskSite, family: Family, others: Sequence[Family]
) -> TaskInstance:
    """A box whose spring shuts its lid, unless that has been swung so far that its weight holds it open. Friction would
    hold it short of that, too.
    """
    del others
    made = task.sample(rng, site)
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
"""How the things of each kind are made."""

NEEDED: Mapping[str, Mapping[str, float]] = MappingProxyType({"open_box": {"swing": 2.05}})
"""Options of a published task without which its things may stand where the arm cannot do what is to be learnt."""
