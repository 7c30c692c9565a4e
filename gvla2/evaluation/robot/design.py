"""The design of the robot suite: which episodes, in which arms, and how failures are classified."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from gvla2.episode.record import EpisodeRecord
from gvla2.errors import ConfigurationError

SUITE = "robot"
EXPLORATION = "robot_exploration"
"""The suite under which the results database stores the arms' experience."""
VERSION = 2
"""The protocol's version: rows of another version are measured again."""

PROFILES = ("relaxed", "strict")
CONTROLS = ("off", "shuffled", "best_theta")
"""Arms without a memory of their own: none, another task's, and a search for theta without a bank."""
MEMORY_OF = MappingProxyType({"on": "governed", "shuffled": "governed"})
"""Arms whose memory has a different name."""

PAPER: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "put_block": (90.3, 75.0),
        "play_jenga": (85.3, 63.3),
        "open_jar": (85.0, 68.7),
        "close_box": (54.7, 31.0),
        "open_box": (38.3, 10.0),
        "pickup_cup": (87.3, 76.7),
        "push_block": (25.0, 15.0),
        "take_umbrella": (68.0, 48.0),
        "sort_mustard": (79.3, 57.3),
        "open_wine": (44.7, 26.3),
        "lamp_on": (78.7, 58.7),
        "put_knife": (63.7, 43.7),
        "pick_and_lift": (90.7, 66.0),
        "insert_block": (34.3, 13.3),
    }
)
"""Success in per cent, with and without memory, as the paper reports it: from another simulator, so not a baseline."""

HOUSE = ("robot", "perceiver", "parts", "verifier", "depth_noise", "scale", "world", "replan", "max_parts")
"""Factors that planners must share to be compared."""
PLANNER = ("planner", "model")
"""Further factors that the arms of a table share."""
EPISODE = (*PLANNER, "task", "arm", "variant", "teacher", "learning", "profile", "seed", "episode")
"""Factors that tell one episode of a house from another."""
STRIDE = 10_000
NAMED = "layouts"
"""The ``seed`` of episodes whose layouts were named and have no seed; ``episode`` is the layout then."""


def layout_seed(seed: int, episode: int) -> int:
    """The seed that lays out an episode: the same for all arms, and never one of the exploration's."""
    return STRIDE * (seed + 1) + episode


def check_seeds(episodes: int, exploration_seeds: Sequence[int], layouts: Sequence[int] = ()) -> None:
    """Raises :class:`ConfigurationError` if exploration could use a test's layout.

    ``layouts`` are those of the test if they are named, instead of ``episodes`` for each seed.
    """
    if episodes > STRIDE:
        raise ConfigurationError(f"episodes is {episodes}; {STRIDE} at most fit to one seed.")
    bad = [seed for seed in exploration_seeds if not 0 <= seed < STRIDE]
    if bad:
        raise ConfigurationError(
            f"exploration_seeds {bad} are not in [0, {STRIDE}): higher ones lay out the test."
        )
    met = sorted(set(exploration_seeds) & set(layouts))
    if met:
        raise ConfigurationError(
            f"layouts {met} are among the exploration_seeds: an explored layout cannot be a test. Choose others."
        )


def ordered(tasks: Sequence[str]) -> list[str]:
    """Each task once, the paper's first in its order; the paper's fourteen if none are given."""
    chosen = list(dict.fromkeys(tasks)) or list(PAPER)
    return [name for name in PAPER if name in chosen] + [name for name in chosen if name not in PAPER]


def stand_in(task: str, tasks: Sequence[str]) -> str:
    """The task whose memories ``shuffled`` gives to ``task``: the next one of those chosen, or of the paper's."""
    return others_of(task, tasks)[0]


def others_of(task: str, tasks: Sequence[str]) -> list[str]:
    """The tasks that could stand in for ``task``, the next one first, never itself."""
    circle = list(tasks) if len(tasks) > 1 else [task, *(name for name in PAPER if name != task)]
    place = circle.index(task)
    return circle[place + 1 :] + circle[:place]


GRASP = ("slipped",)
UNSEEN = ("nothing_matches", "ambiguous", "perception")
NOT_MEASURED = ("timeout", "unavailable")
"""Kinds of failure that do not count against an arm: its planner timed out, or its model was unavailable."""


def failure_class(record: EpisodeRecord) -> str:
    """Where an episode that did not reach its goal went wrong, in one of ten words; "" for no failure.

    ``unnoticed``: the robot's own verifier saw nothing wrong. ``not_achieved``: it ran to its end and noticed the
    failure. ``unavailable``: the planner's model did not answer; the plan, if any, was another's.
    """
    failure = record.failure
    asked = record.language.get("plan", {})
    if asked.get("failed") and not asked.get("calls") and not asked.get("cached"):
        return "unavailable"
    if failure is None:
        return ""
    if failure.kind in NOT_MEASURED:
        return failure.kind
    if failure.kind in ("crashed", "error", "interrupted", "simulation"):
        return "error"
    if failure.stage in ("setup", "observe", "perceive", "reconstruct") or failure.kind in UNSEEN:
        return "perception"
    if failure.stage == "plan":
        return "abstained"
    if failure.stage == "check":
        return "plan_rejected"
    if failure.stage == "execute":
        return "grasp" if failure.kind in GRASP else "execution"
    return "unnoticed" if failure.stage == "success_check" else "not_achieved"
