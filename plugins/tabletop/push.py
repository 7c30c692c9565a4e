"""Push a block onto a painted square, or the sprung button of a lamp."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import planar
from gvla2.robot.solids import Volume
from gvla2.robot.task import Body, Glow, Joint, Layout, Primitive, TaskInstance, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import DOWN, PAINT, Draw, TabletopTask, box, lifted

SIZE, MASS, TARGET, DISTANCE = 0.0563, 0.356, 0.10, (0.15, 0.30)
"""Side of the block and of the target, metres; kilograms; distance of the block from the target's centre, metres."""

CENTRE_VOLUME = 0.01
"""Side of the strict profile's cube at the target's centre, metres."""

ROOM_BEHIND = 0.08
"""How far behind the block, seen from the target, the hand must reach to push it, metres."""


class PushBlock(TabletopTask[ScaledConfig]):
    """Push the block onto the target.

    relaxed: the block's centre is above the painted square and the block lies on the table. strict: the block
    overlaps a cube of 1 cm that stands at the target's centre.
    """

    name = "push_block"
    instructions = (
        "push the {colour} block onto the {target} square",
        "slide the {colour} cube to the {target} target",
        "shove the {colour} block over to the {target} patch on the table",
        "move the {colour} cube onto the {target} square by pushing it",
        "without lifting it, push the {colour} block until it is on the {target} target",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A block and its target."""
        size, table = self.scale * SIZE, draw.site.table_height
        start, spot = draw.until(lambda: self._poses(draw, size), "a block and its target")
        colour, target_colour = draw.colours(2)
        block = Body("block", (box([size] * 3, COLOURS[colour]),), start, MASS, label=f"{colour} cube")
        paint = box((TARGET, TARGET, PAINT), COLOURS[target_colour], collides=False)
        target = Body("target", (paint,), spot, fixed=True, label=f"{target_colour} square")
        middle = rigid(spot[:3, :3], (spot[0, 3], spot[1, 3], table + CENTRE_VOLUME / 2))
        volume = Volume(middle, (CENTRE_VOLUME, CENTRE_VOLUME, CENTRE_VOLUME))

        def relaxed(world: WorldState) -> bool:
            now = world.pose("block")[:3, 3]
            offset = transform_points(invert_rigid(spot), now)
            return bool((np.abs(offset[:2]) <= TARGET / 2).all() and now[2] < table + size)

        return draw.instance(
            Layout((block, target)),
            relaxed,
            lambda world: volume.meets(block, world.pose("block")),
            f"relaxed: the {colour} block's centre is on the {target_colour} square; "
            "strict: the block covers the square's centre",
            colour=colour,
            target=target_colour,
        )

    def _poses(self, draw: Draw, size: float) -> tuple[FloatArray, FloatArray] | None:
        """Poses (4, 4) of the block's and the paint's centre; None when one is out of place."""
        root = draw.root()
        distance = float(draw.rng.uniform(*DISTANCE))
        direction, block_yaw, target_yaw = draw.rng.uniform(-np.pi, np.pi, size=3)
        start = root[:2, 3]
        towards = np.array([np.cos(direction), np.sin(direction)])
        goal = start + distance * towards
        free = distance - (size + TARGET) / np.sqrt(2.0) > 0
        if (
            not free
            or not draw.inside(start, size / np.sqrt(2.0))
            or not draw.inside(goal, TARGET / np.sqrt(2))
        ):
            return None
        if not all(draw.in_reach(xy, size / 2, 0.15) for xy in (start - ROOM_BEHIND * towards, goal)):
            return None
        table = draw.site.table_height
        return (
            planar(start, table + size / 2, float(block_yaw)),
            planar(goal, table + PAINT / 2, float(target_yaw)),
        )


EASED_TRAVEL, STRICT_TRAVEL = 0.003, 0.0075
"""Travel of the button that counts, metres."""

DIAMETER, HEIGHT, TRAVEL, STIFFNESS = 0.033, 0.024, 0.010, 400.0
"""The button: its top above the table and its travel, metres; N/m."""

BASE = (0.16, 0.08, 0.010)
BUTTON_X, POST_X = -0.045, 0.045
POST = (0.014, 0.014, 0.055)
SHADE = (0.060, 0.060, 0.035)
"""The lamp, metres. It stays below the hand's palm when the fingers press the button, so that any yaw of the hand
has room."""

BASE_RGB, POST_RGB, SHADE_RGB = (0.16, 0.16, 0.18), (0.20, 0.20, 0.22), (0.28, 0.27, 0.26)

SHADE_SOLID, LIT_RGB = 2, (1.0, 0.93, 0.62)
"""Which solid of the lamp shines when it is on, and how."""

PRELOAD = 0.002
"""How far beyond its stop the spring rests, metres: the button carries its own weight without sinking."""


class LampOn(TabletopTask[ScaledConfig]):
    """Press the button of a lamp. Success is the largest travel of the button, since a spring brings it back.

    relaxed: more than 3 mm. strict: more than 7.5 mm, of 10 mm.
    """

    name = "lamp_on"
    instructions = (
        "turn on the lamp",
        "press the {colour} button to switch the lamp on",
        "push the {colour} button of the lamp",
        "switch the light on by pressing the {colour} button",
        "press the lamp's button",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A lamp and its button."""
        root = draw.until(lambda: self._root(draw), "a lamp")
        (colour,) = draw.colours(1, beside=(BASE_RGB, POST_RGB, SHADE_RGB))
        height = HEIGHT - BASE[2]
        diameter, post_top = self.scale * DIAMETER, BASE[2] + POST[2]
        solids = (
            Primitive("box", BASE, BASE_RGB, lifted(BASE[2] / 2)),
            Primitive("cylinder", POST, POST_RGB, lifted(BASE[2] + POST[2] / 2, POST_X)),
            Primitive("cylinder", SHADE, SHADE_RGB, lifted(post_top + SHADE[2] / 2, POST_X)),
        )
        lamp = Body("lamp", solids, root, mass=0.5, fixed=True)
        centre = root @ lifted(BASE[2] + height / 2, BUTTON_X)
        plate = Primitive("cylinder", (diameter, diameter, height), COLOURS[colour])
        button = Body("button", (plate,), centre, mass=0.02, label=f"{colour} button")
        slide = Joint(
            "press", "prismatic", "lamp", "button", axis=DOWN, origin=centre[:3, 3], limits=(0.0, TRAVEL),
            rest=-PRELOAD, stiffness=STIFFNESS, damping=4.0,
        )  # fmt: skip
        return draw.instance(
            Layout((lamp, button), (slide,), (Glow("lamp", SHADE_SOLID, "press", STRICT_TRAVEL, LIT_RGB),)),
            lambda world: world.peak("press") > EASED_TRAVEL,
            lambda world: world.peak("press") > STRICT_TRAVEL,
            f"relaxed: the button went down by more than {EASED_TRAVEL * 1000:g} mm; "
            f"strict: by more than {STRICT_TRAVEL * 1000:g} mm",
            colour=colour,
        )

    def _root(self, draw: Draw) -> FloatArray | None:
        """Pose (4, 4) of the middle of the base's underside; None when it is out of place."""
        root = draw.root()
        button = transform_points(root, (BUTTON_X, 0.0, 0.0))[:2]
        if not draw.inside(root[:2, 3], 0.5 * float(np.hypot(BASE[0], BASE[1]))):
            return None
        return root if draw.in_reach(button, 0.01, HEIGHT + 0.15) else None
