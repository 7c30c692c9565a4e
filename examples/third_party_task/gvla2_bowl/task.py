"""The task itself; imported when `task=ball_in_bowl` was chosen."""

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import rigid
from gvla2.planning.colours import COLOURS, DISTINCT, colour_distance, colours_in
from gvla2.robot.solids import Volume, cup
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, TaskSite, WorldState

HEIGHT, WALL = 0.05, 0.006  # of the bowl, metres
BALL_MASS, BOWL_MASS = 0.05, 0.4  # kilograms
GAP = 0.06  # between all things: room for the hand, metres
TRIES = 2000


class BallInBowl:
    """Two balls and a bowl; the ball of the named colour goes into it.

    relaxed: the ball is within the bowl's walls, no higher than its rim, and not held. strict: and it lies still.
    """

    def __init__(self, config):
        if not 0.03 <= config.ball <= 0.07 or not 1.8 * config.ball <= config.bowl <= 0.25:
            raise ConfigurationError(
                "task=ball_in_bowl takes task.ball from 0.03 to 0.07 m, which the hand can span, and task.bowl from "
                f"1.8 times that to 0.25 m; got ball={config.ball}, bowl={config.bowl}."
            )
        self.ball, self.bowl = config.ball, config.bowl

    @property
    def instructions(self):
        """Paraphrases; ``{colour}`` is the ball's colour."""
        return (
            "put the {colour} ball in the bowl",
            "place the {colour} ball into the bowl",
            "drop the {colour} ball into the bowl, please",
            "pick up the {colour} ball and put it in the bowl",
            "could you put the {colour} ball inside the bowl?",
        )

    def sample(self, rng: np.random.Generator, site: TaskSite, instruction=None) -> TaskInstance:
        """One episode; a given ``instruction`` decides the ball if it names the colour of exactly one."""
        spots = self._spots(rng, site)  # of both balls and the bowl
        colours = _colours(rng, site, 3)
        drawn = self.instructions[int(rng.integers(len(self.instructions)))].format(colour=colours[0])
        target, aside = 0, ""
        if instruction is not None:
            named = [i for i in (0, 1) if colours[i] in colours_in(instruction)]
            if len(named) == 1:
                target = named[0]
            else:
                aside = "; the sentence names no single ball by its colour, so the seed's own is judged"

        table, name = site.table_height, f"ball_{target}"
        balls = tuple(
            Body(
                f"ball_{i}",
                (Primitive("sphere", (self.ball,) * 3, COLOURS[colours[i]]),),
                rigid(translation=(*spots[i], table + self.ball / 2)),
                BALL_MASS,
                label=f"{colours[i]} ball",
            )
            for i in (0, 1)
        )
        walls = cup(self.bowl, HEIGHT, WALL, COLOURS[colours[2]])
        place = rigid(translation=(*spots[2], table))
        bowl = Body("bowl", walls, place, BOWL_MASS, label=f"{colours[2]} bowl", shape="cylinder")

        def relaxed(world: WorldState) -> bool:
            middle = world.pose("bowl") @ rigid(translation=(0, 0, HEIGHT / 2))
            inner = self.bowl - 2 * WALL
            within = Volume(middle, (inner, inner, HEIGHT), round=True)
            return within.holds(world.pose(name)[:3, 3]) and not world.held(name)

        def strict(world: WorldState) -> bool:
            return relaxed(world) and world.resting(name)

        return TaskInstance(
            drawn if instruction is None else instruction,
            Layout((*balls, bowl)),
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the {colours[target]} ball is in the bowl, let go of; strict: it lies still there{aside}",
        )

    def _spots(self, rng, site):
        """(3, 2) places x, y of two balls and the bowl: inside the site, apart, and in reach from above."""
        radii = 0.5 * np.array([self.ball, self.ball, self.bowl])
        half = 0.5 * np.asarray(site.size) - radii[:, None]
        for _ in range(TRIES):
            spots = np.asarray(site.centre) + rng.uniform(-half, half)
            apart = [
                np.linalg.norm(spots[i] - spots[j]) - radii[i] - radii[j] for i, j in ((0, 1), (0, 2), (1, 2))
            ]
            if min(apart) < GAP:
                continue
            if all(
                site.reachable(np.array([*xy, site.table_height + z])) for xy in spots for z in (0.02, 0.25)
            ):
                return spots
        raise ConfigurationError(f"No place for two balls and a bowl was found in {TRIES} tries.")


def _colours(rng, site, count):
    """Colour words that can be told from one another and from the table."""
    taken = [] if site.table_rgb is None else [site.table_rgb]
    names = []
    for name in rng.permutation(list(COLOURS)):
        if not taken or (colour_distance(np.array(taken), COLOURS[name]) >= DISTINCT).all():
            names.append(str(name))
            taken.append(COLOURS[name])
        if len(names) == count:
            return names
    raise ConfigurationError(f"There are no {count} colours that can be told apart on this table.")
