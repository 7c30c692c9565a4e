"""Pull a drawer open by its handle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.placing import at, inside, sample_root, sample_until
from gvla2.robot.solids import tray
from gvla2.robot.task import Body, Joint, Layout, Primitive, Solution, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import best_path, through
from gvla2_plugins.tabletop.scenes import lifted, sample_colours, sentence_of

CABINET, BOARD = (0.24, 0.28, 0.16), 0.012
INNER_GAP = 0.004
TRAVEL, OPEN = 0.18, 0.10
BAR, BAR_LENGTH, BAR_OUT, BAR_HEIGHT = 0.012, 0.11, 0.040, 0.125
YAW = np.pi / 8
"""Metres. The cabinet's front looks to -x of its root; the bar of the handle runs across it, ``BAR_OUT`` before it."""

HANDLE_RGB = (0.25, 0.25, 0.27)

STANDOFF, PULL = 0.06, 0.15
LEANS = (0.0, 0.3, 0.6)
HAND_HALF, PALM_BACK, HAND_ROOM = 0.102, 0.06, 0.012
"""How far the hand may point down, radians; half of a broad hand's breadth, how far its palm is behind the fingertips
and what room it needs over the table, metres.
"""


class OpenDrawer:
    """Open the drawer. relaxed: it was pulled out by more than 10 cm at some time. strict: it still is."""

    instructions = (
        "open the drawer",
        "pull the {colour} drawer open",
        "open the {colour} drawer by its handle",
        "slide the drawer out of the cabinet",
        "please pull the drawer open",
    )
    """Paraphrases; ``{colour}`` is the drawer's colour."""

    def __init__(self, config: ScaledConfig) -> None:
        self._scale = config.factor("open_drawer")

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one drawer, whatever ``instruction`` says."""
        root = sample_until(lambda: self._draw(rng, site), "a cabinet")
        colour, body_colour = sample_colours(rng, site, 2, beside=(HANDLE_RGB,))
        layout = Layout(*self._furniture(root, colour, body_colour))

        def relaxed(world: WorldState) -> bool:
            return world.peak("slide") > OPEN

        def strict(world: WorldState) -> bool:
            return world.joint("slide") > OPEN

        return TaskInstance(
            layout,
            sentence_of(rng, self.instructions, instruction, colour=colour),
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the drawer was pulled out by more than {OPEN:g} m; strict: it still is",
            solution=pull_handle("drawer", ("cabinet",), handle_paths(root, self._scale)),
        )  # fmt: skip

    def _furniture(
        self, root: FloatArray, colour: str, body_colour: str
    ) -> tuple[tuple[Body, Body], tuple[Joint]]:
        k = self._scale
        x, y, z = (k * side for side in CABINET)
        rgb, front = COLOURS[body_colour], COLOURS[colour]
        board = (
            ((x, y, BOARD), (0.0, 0.0, BOARD / 2)),
            ((x, y, BOARD), (0.0, 0.0, z - BOARD / 2)),
            ((x, BOARD, z - 2 * BOARD), (0.0, (y - BOARD) / 2, z / 2)),
            ((x, BOARD, z - 2 * BOARD), (0.0, (BOARD - y) / 2, z / 2)),
            ((BOARD, y - 2 * BOARD, z - 2 * BOARD), ((x - BOARD) / 2, 0.0, z / 2)),
        )
        carcass = tuple(Primitive("box", size, rgb, rigid(translation=place)) for size, place in board)
        inner = (x - 2 * BOARD, y - 2 * BOARD - 2 * INNER_GAP, z - 2 * BOARD - 2 * INNER_GAP)
        bottom = BOARD + INNER_GAP
        face = Primitive(
            "box",
            (BOARD, inner[1], inner[2]),
            front,
            rigid(translation=(-x / 2 + BOARD / 2, 0, bottom + inner[2] / 2)),
        )
        tub = tuple(
            Primitive(s.kind, s.size, s.rgb, lifted(bottom) @ s.body_from_shape)
            for s in tray((inner[0], inner[1], 0.7 * inner[2]), 0.006, front)
        )
        out, length, height = -x / 2 - k * BAR_OUT, k * BAR_LENGTH, k * BAR_HEIGHT
        bar = Primitive("box", (BAR, length, BAR), HANDLE_RGB, rigid(translation=(out, 0.0, height)))
        posts = tuple(
            Primitive(
                "box",
                (k * BAR_OUT, BAR, BAR),
                HANDLE_RGB,
                rigid(translation=(-x / 2 - k * BAR_OUT / 2, end, height)),
            )
            for end in ((length - BAR) / 2, -(length - BAR) / 2)
        )
        return (
            Body("cabinet", carcass, root, 3.0, fixed=True, label=f"{body_colour} cabinet", shape="box"),
            Body(
                "drawer", (face, *tub, bar, *posts), root, 0.6, label=f"{colour} drawer", shape="box",
                parts=(("handle", tuple(range(1 + len(tub), 4 + len(tub)))),),
            ),
        ), (
            Joint(
                "slide", "prismatic", "cabinet", "drawer", axis=-root[:3, 0], origin=root[:3, 3],
                limits=(0.0, TRAVEL), damping=8.0, friction=0.5,
            ),
        )  # fmt: skip

    def _draw(self, rng: np.random.Generator, site: TaskSite) -> FloatArray | None:
        root, k = sample_root(rng, site, YAW), self._scale
        x, y = k * CABINET[0] / 2, k * CABINET[1] / 2
        corners = [at(root, sx * x, sy * y)[:2, 3] for sx in (-1, 1) for sy in (-1, 1)]
        if not all(inside(site, corner, 0.0) for corner in corners):
            return None
        return root if any(site.follows(path) for path in handle_paths(root, k)) else None


def handle_paths(root: FloatArray, k: float) -> list[list[FloatArray]]:
    """Every :func:`handle_path` of the leans that leave the hand room, with the hand either way round."""
    lowest = [k * BAR_HEIGHT + PALM_BACK * np.sin(lean) - HAND_HALF * np.cos(lean) for lean in LEANS]
    leans = [lean for lean, low in zip(LEANS, lowest, strict=True) if low > HAND_ROOM]
    return [handle_path(root, k, sign, lean) for lean in leans for sign in (1.0, -1.0)]


def handle_path(root: FloatArray, k: float, sign: float, lean: float) -> list[FloatArray]:
    """Tool poses (4, 4): before the bar, at it with a finger above and one below, pulled out.

    The hand points down by ``lean`` radians.
    """
    out, up = -root[:3, 0], np.array([0.0, 0.0, 1.0])
    approach = -np.cos(lean) * out - np.sin(lean) * up
    turned = grasp_rotation(approach, sign * (np.cos(lean) * up - np.sin(lean) * out))
    bar = at(root, -k * (CABINET[0] / 2 + BAR_OUT), 0.0, k * BAR_HEIGHT)[:3, 3]
    return [rigid(turned, spot) for spot in (bar - STANDOFF * approach, bar, bar + PULL * out)]


def pull_handle(obj: str, near: Sequence[str], ways: Sequence[Sequence[FloatArray]]) -> Solution:
    """One of several ways of tool poses (4, 4): before the handle, at it, pulled."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        before, grasp, pulled = ways[best_path(arm, ways)]
        contacts = {obj, *near, "table"}
        yield [
            *through("approach", [before], 0.6, free=True),
            *through("reach", [grasp], 0.6, speed=0.1, contacts=contacts),
            *through("grasp", [grasp], 0.0, contacts=contacts),
            *through("pull", [pulled], 0.0, speed=0.1, contacts=contacts, tolerance=0.02),
            *through("release", [pulled], 0.6, contacts=contacts),
        ]

    return solve
