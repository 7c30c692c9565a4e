"""Pull the brick that sticks out of a tower of bricks, and carry it away."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.placing import at, inside, sample_root, sample_until
from gvla2.robot.solids import Volume
from gvla2.robot.task import Body, Layout, Primitive, Solution, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import DOWN, best_path, through
from gvla2_plugins.tabletop.scenes import PAINT, sample_colours, sentence_of

BRICK, MASS = (0.2, 0.067, 0.033), 0.448
LOOSE = 0.9
"""The loose brick's scale; its mass goes with the cube: 0.327 kg."""

LAYERS, LAYER, SLOT = 5, 3, 1
"""Layers of three bricks, and the loose one's place among them: its middle is 0.114 m above the table."""

STICKS_OUT = 0.06
GOAL, GOAL_RADIUS, GOAL_HEIGHT = (0.225, 0.2), 0.05, 0.2
YAW = np.pi / 8
"""Metres; the goal is an upright cylinder over a painted circle, in the root's frame. The brick sticks out to +y."""

STAYED = 0.03
"""How far a brick may be from where it was and still count as standing, metres: half of one's breadth."""

WOOD = (0.93, 0.91, 0.86)


class PlayJenga:
    """Take the loose brick out of the tower. relaxed: some part of it is in the goal's cylinder. strict: the same,
    released, while all others still stand in place.
    """

    instructions = (
        "pull the {colour} block out of the jenga tower and put it on the {target} circle",
        "take the protruding {colour} brick out of the tower and lay it on the {target} circle",
        "play jenga: remove the {colour} block without toppling the tower, and put it on the {target} circle",
        "slide the {colour} block that sticks out of the stack out of it and onto the {target} circle",
        "grab the {colour} jenga block, pull it out and set it down on the {target} circle",
    )
    """Paraphrases; ``{colour}`` is the loose brick's colour, ``{target}`` that of the circle beside the tower."""

    def __init__(self, config: ScaledConfig) -> None:
        self._scale = config.factor("play_jenga")

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; one brick sticks out, whatever ``instruction`` says."""
        k = self._scale
        root = sample_until(lambda: self._draw(rng, site), "a tower of bricks")
        colour, circle = sample_colours(rng, site, 2, beside=(WOOD,))
        bricks = []
        for layer in range(LAYERS):
            for slot in range(3):
                if (layer, slot) == (LAYER, SLOT):
                    bricks.append(self._loose(root, colour))
                    continue
                across = k * (slot - 1) * BRICK[1]
                spot = (across, 0.0) if layer % 2 else (0.0, across)
                pose = at(root, *spot, k * (layer + 0.5) * BRICK[2], np.pi / 2 if layer % 2 else 0.0)
                x, y, z = (k * side for side in BRICK)
                solid = Primitive("box", (x, y, z), WOOD)
                bricks.append(Body(f"brick_{layer}_{slot}", (solid,), pose, MASS, label="white brick"))
        others = [b for b in bricks if b.name != "loose"]
        paint = Primitive(
            "cylinder", (2 * GOAL_RADIUS, 2 * GOAL_RADIUS, PAINT), COLOURS[circle], collides=False
        )
        place = at(root, *GOAL, PAINT / 2)
        bricks.append(Body("circle", (paint,), place, fixed=True, label=f"{circle} circle"))
        layout = Layout(tuple(bricks))
        height = k * GOAL_HEIGHT
        goal = Volume(at(root, *GOAL, height / 2), (2 * GOAL_RADIUS, 2 * GOAL_RADIUS, height), round=True)

        def relaxed(world: WorldState) -> bool:
            return goal.meets(layout["loose"], world.pose("loose"))

        def strict(world: WorldState) -> bool:
            moved = [np.linalg.norm(world.pose(b.name)[:3, 3] - b.world_from_body[:3, 3]) for b in others]
            return bool(relaxed(world) and world.resting("loose") and max(moved) < k * STAYED)

        return TaskInstance(
            layout,
            sentence_of(rng, self.instructions, instruction, colour=colour, target=circle),
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the {colour} brick is over the {circle} circle; strict: let go of, and the others stand",
            solution=pull_brick(lambda pose: brick_path(root, pose, k)),
        )

    def _loose(self, root: FloatArray, colour: str) -> Body:
        k = self._scale
        x, y, z = (k * LOOSE * side for side in BRICK)
        middle = k * (BRICK[0] / 2 + STICKS_OUT) - x / 2
        pose = at(root, 0.0, middle, k * LAYER * BRICK[2] + z / 2, np.pi / 2)
        solid = Primitive("box", (x, y, z), COLOURS[colour])
        return Body("loose", (solid,), pose, MASS * LOOSE**3, label=f"{colour} brick")

    def _draw(self, rng: np.random.Generator, site: TaskSite) -> FloatArray | None:
        root, k = sample_root(rng, site, YAW), self._scale
        end = at(root, 0.0, k * (BRICK[0] / 2 + STICKS_OUT))[:2, 3]
        if not inside(site, root[:2, 3], k * BRICK[0] / np.sqrt(2)) or not inside(site, end, 0.03):
            return None
        if not inside(site, at(root, *GOAL)[:2, 3], GOAL_RADIUS):
            return None
        pose = self._loose(root, "red").world_from_body
        ways = [brick_path(root, pose, k) @ rigid(np.diag([s, s, 1.0])) for s in (1.0, -1.0)]
        return root if any(site.follows(list(way)) for way in ways) else None


FROM_END = 0.02
"""Of the grasp from the brick's end, metres: the palm stays clear of the tower."""

DRAWN, CLEAR = 0.20, 0.06


def brick_path(root: FloatArray, brick: FloatArray, scale: float) -> FloatArray:
    """(6, 4, 4) tool poses: above the brick's end, at it, drawn out, aside, set down, above again.

    ``brick`` (4, 4), its x axis pointing out of the tower.
    """
    out, across = brick[:3, 0], root[:3, 0]
    turned = grasp_rotation(DOWN, brick[:3, 1])
    grasp = brick[:3, 3] + out * (scale * LOOSE * BRICK[0] / 2 - FROM_END)
    drawn = grasp + out * scale * DRAWN
    # The brick's middle comes over the goal.
    goal = root[:3, 3] + root[:3, :2] @ np.asarray(GOAL)
    aside = drawn + across * float((goal - drawn) @ across)
    down = goal + (grasp - brick[:3, 3])
    down[2] = root[2, 3] + scale * LOOSE * BRICK[2] / 2 + 0.003
    points = [grasp - CLEAR * DOWN, grasp, drawn, aside, down, down - CLEAR * DOWN]
    return np.stack([rigid(turned, point) for point in points])


def pull_brick(path: Callable[[FloatArray], FloatArray]) -> Solution:
    """Pull the body ``loose`` along the tool path that ``path`` gives for its pose."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        poses = path(world.pose("loose"))
        ways = [list(poses @ rigid(np.diag([sign, sign, 1.0]))) for sign in (1.0, -1.0)]
        above, grasp, drawn, aside, down, away = ways[best_path(arm, ways)]
        near = ["loose", "table", *(f"brick_{layer}_{slot}" for layer in range(5) for slot in range(3))]
        yield [
            *through("approach", [above], 0.95, free=True, contacts=near),
            *through("reach", [grasp], 0.95, contacts=near, speed=0.1),
            *through("grasp", [grasp], 0.0, contacts=near),
            *through("pull", [drawn, aside, down], 0.0, contacts=near, carries="loose"),
            *through("release", [down], 1.0, contacts=near),
            *through("leave", [away], 1.0, contacts=near),
        ]

    return solve
