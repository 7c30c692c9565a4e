"""The robot suite's design: each planner's episodes, what identifies them, and what they have in common."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from itertools import product
from types import MappingProxyType
from typing import Any

from gvla2.component import ComponentConfig, described
from gvla2.errors import ConfigurationError
from gvla2.evaluation.arms import MEMORY, WITHOUT_BANK, BenchArm, chosen_arms, chosen_memory
from gvla2.evaluation.components import (
    code_of,
    configured,
    given_label,
    given_options,
    model_label,
    noise_label,
    options_of,
    require_among,
    task_options,
)
from gvla2.evaluation.config import RobotBench
from gvla2.evaluation.results import cell_key, versions
from gvla2.evaluation.suites.robot_episodes import EXPLORED, EpisodeUnit, components
from gvla2.plugins.assembly import GEOMETRY, LOOP
from gvla2.plugins.kinds import KINDS, NONE, OWN_TASK
from gvla2.plugins.registry import Registry
from gvla2.robot.backend import OffersTasks

SUITE = "robot"
VERSION = 2
"""The protocol's version: rows of another version are measured again."""
EXPLORATION = "robot_exploration"
"""The name under which the results database stores the arms' experience."""
PROFILES = ("relaxed", "strict")
LEARNABLE = "learnable"
FAMILY = ", family "
"""Between a task and the number of a family in a row's name."""
STRIDE = 10_000
"""Layouts of one seed; those below it are for exploration and for layouts that are named."""
NAMED = "layouts"
"""The ``seed`` of episodes whose layouts were named and have no seed; ``episode`` is the layout then."""
MEASURING_CODE = (
    "gvla2.episode", "gvla2.evaluation.arms", "gvla2.evaluation.suites.robot", "gvla2.evaluation.suites.robot_episodes",
    "gvla2.geometry", "gvla2.memory", "gvla2.perception", "gvla2.planning",
    "gvla2.reconstruction", "gvla2.robot", "gvla2.skills",
)  # fmt: skip
"""Code whose change outdates stored rows, besides the chosen plugins."""
ASKING_CODE = ("gvla2.language",)
"""The same, for rows that used a language model."""
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


@dataclass(frozen=True)
class Design:
    """One planner's episodes in one world; ``config`` is the bench with it.

    ``subjects`` are the rows: their names with the task's name and options.
    """

    config: RobotBench
    subjects: Mapping[str, Mapping[str, Any]]
    plan: Sequence[EpisodeUnit]
    exploring: Sequence[EpisodeUnit]

    @property
    def place(self) -> str:
        """A folder name unique among the designs of the bench."""
        return place_of(self.config)


def place_of(config: RobotBench) -> str:
    """A folder name for a planner, in a learnable world with the world's number."""
    world = f"-world{config.seeds[0]}" if config.world == LEARNABLE else ""
    return f"{config.planner.name}{world}"


def designs(config: RobotBench, registry: Registry) -> list[Design]:
    """A design for each planner of the bench, all over the same rows, arms and layouts.

    In a learnable world a planner has one for each seed, since each is a different world, explored anew.

    Raises :class:`ConfigurationError` for names and options that do not exist, and for a layout that exploration uses
    too.
    """
    arms = chosen_arms(config, registry)
    planners = list(dict.fromkeys(config.planners)) or [config.planner.name]
    teachers = [config.teacher] if config.teacher else []
    require_among("planner_options", config.planner_options, [*planners, *teachers], "planners")
    _check_seeds(config, learns=any(arm.learns for arm in arms))
    worlds = [replace(config, seeds=[seed]) for seed in dict.fromkeys(config.seeds)]
    return [
        _design(
            with_planner(world, registry, name),
            with_planner(world, registry, config.teacher or name),
            registry,
            arms,
        )
        for world in (worlds if config.world == LEARNABLE else [config])
        for name in planners
    ]


def _check_seeds(config: RobotBench, learns: bool) -> None:
    """Raises :class:`ConfigurationError` if exploration could use a test's layout, or would do nothing."""
    usable = [seed for seed in config.exploration_seeds if 0 <= seed < STRIDE]
    shared = sorted(set(usable) & set(config.layouts))
    for holds, message in (
        (learns or not config.teacher, f"teacher is '{config.teacher}', but no arm learns."),
        (
            config.exploration_seeds or not learns,
            "exploration_seeds is empty, but there are arms that learn.",
        ),
        (config.episodes <= STRIDE, f"episodes is {config.episodes}; {STRIDE} at most fit to one seed."),
        (
            usable == config.exploration_seeds,
            f"exploration_seeds {config.exploration_seeds} are not in [0, {STRIDE}): higher ones lay out the test.",
        ),
        (
            not shared or not learns,
            f"layouts {shared} are among the exploration_seeds: an explored layout cannot be a test. Choose others.",
        ),
        (
            config.world == LEARNABLE or config.families == RobotBench().families,
            f"families is {config.families}; there are families in world={LEARNABLE} only.",
        ),
    ):
        if not holds:
            raise ConfigurationError(message)


def subjects(config: RobotBench, registry: Registry) -> dict[str, dict[str, Any]]:
    """The rows of the bench in their order: each one's name, and the task's name and options.

    In a learnable world there is a row per family, and the world is that of the bench's first seed. Raises
    :class:`ConfigurationError` for options that a task does not have.
    """
    found: dict[str, dict[str, Any]] = {}
    names = ordered(_own_tasks(config, registry) or config.tasks or _default_tasks(config, registry))
    require_among("task_options", config.task_options, names, "tasks")
    world = {"world": LEARNABLE, "world_seed": config.seeds[0], "families": config.families}
    for name in names:
        options, label = task_options(config, registry, name), given_label(name, config.task_options)
        if config.world != LEARNABLE:
            found[label] = {"name": name, **options}
            continue
        if "family" not in options_of(registry, "task", name):
            raise ConfigurationError(f"world is {LEARNABLE}, but the task '{name}' has no option 'family'.")
        for family in range(config.families):
            found[f"{label}{FAMILY}{family}"] = {"name": name, **options, **world, "family": family}
    return found


def _own_tasks(config: RobotBench, registry: Registry) -> list[str]:
    """The tasks of a robot that offers some itself, ``suite/*`` standing for a whole suite; none for other robots.

    Raises :class:`ConfigurationError` for a pattern that fits none of them, and without any pattern.
    """
    if not any(OWN_TASK in name for name in config.tasks):
        return []
    with closing(registry.build(config, "robot")) as robot:
        offered = list(robot.tasks()) if isinstance(robot, OffersTasks) else []
    found: list[str] = []
    for pattern in config.tasks:
        fitting = fnmatch.filter(offered, pattern)
        if not fitting:
            some = ", ".join(dict.fromkeys(f"{name.partition(OWN_TASK)[0]}/*" for name in offered))
            raise ConfigurationError(
                f"tasks: robot={config.robot.name} offers nothing like '{pattern}'; it offers {some or 'none'}."
            )
        found += fitting
    return found


def _default_tasks(config: RobotBench, registry: Registry) -> list[str]:
    """The paper's fourteen, or in a learnable world all that have something to learn."""
    if config.world != LEARNABLE:
        return list(PAPER)

    def learnable(name: str) -> bool:
        try:
            registry.build({"task": {"name": name, "world": LEARNABLE}}, "task")
        except ConfigurationError:
            return False
        return True

    return [
        name
        for name in registry.components("task")
        if "family" in options_of(registry, "task", name) and learnable(name)
    ]


def ordered(tasks: Sequence[str]) -> list[str]:
    """Each task once, the paper's first in its order; the paper's fourteen if none are given."""
    chosen = list(dict.fromkeys(tasks)) or list(PAPER)
    return [name for name in PAPER if name in chosen] + [name for name in chosen if name not in PAPER]


def others_of(subject: str, rows: Sequence[str]) -> list[str]:
    """The rows that could stand in for one, for the control ``shuffled``: the next one first, never itself.

    Where it is the only one, the paper's tasks.
    """
    circle = list(rows) if len(rows) > 1 else [subject, *(name for name in PAPER if name != subject)]
    place = circle.index(subject)
    return circle[place + 1 :] + circle[:place]


def with_planner(config: RobotBench, registry: Registry, name: str) -> RobotBench:
    """The bench with one of its planners, configured; a planner is not its own fallback."""
    registry.get("planner", name)
    place, known = f"planner_options.{name}", options_of(registry, "planner", name)
    given = given_options(place, config.planner_options.get(name) or {}, f"the planner '{name}'", known)
    own = config.planner if config.planner.name == name else None
    base = {"name": name} if own is None else asdict(own)
    planner = own if own and not given else registry.configure({"planner": {**base, **given}}, "planner")[0]
    fallback = ComponentConfig(name=NONE) if config.fallback.name == name else config.fallback
    return replace(config, planner=planner, fallback=fallback)


def _design(config: RobotBench, teaching: RobotBench, registry: Registry, arms: Sequence[BenchArm]) -> Design:
    """One planner's episodes with their keys, which name everything that could change them.

    ``teaching`` is the bench with the planner that explores.
    """
    rows = subjects(config, registry)
    explored = dict(rows) if any(arm.learns for arm in arms) else {}
    if any(arm.source == "shuffled" for arm in arms) and len(rows) == 1:  # the control needs another task
        other = others_of(next(iter(rows)), list(rows))[0]
        explored[other] = {"name": other, **({"scale": config.scale} if config.scale != 1 else {})}
    around, taught = _around(config, registry, rows), _around(teaching, registry, explored)
    how = (config.exploration, config.exploration_replan)
    explorer = BenchArm(EXPLORED, "off", replan=config.exploration_replan)
    exploring = []
    for subject, seed in product(explored, dict.fromkeys(config.exploration_seeds)):
        here: dict[str, str | int] = {"task": subject, "arm": EXPLORED, "seed": seed}
        key = cell_key(EXPLORATION, here, taught[subject], *how)
        factors = {**here, "planner": planner_label(teaching)}
        exploring.append(_unit(teaching, subject, explored[subject], explorer, seed, {"both": key}, factors))
    learnt = (list(explored), config.exploration_seeds, *how, [taught[subject] for subject in explored])
    common = _common(config, registry)
    teacher = planner_label(teaching) if planner_label(teaching) != planner_label(config) else ""
    plan = []
    for (subject, task), arm in product(rows.items(), arms):
        past: Any = (learnt, _memory_key(config, registry, arm)) if arm.learns else ()
        own = {"learning": _learning_label(config, arm)} if arm.learns else {}
        own |= {"teacher": teacher} if arm.learns and teacher else {}
        own |= {"variant": arm.variant} if arm.variant else {}
        if arm.replan is not None or arm.explored is not None:
            past = (past, arm.replan, arm.explored)
        for place, layout in _places(config):
            here = {"task": subject, "arm": arm.name, **place}
            keys = {p: cell_key(SUITE, here, p, around[subject], past) for p in PROFILES}
            plan.append(_unit(config, subject, task, arm, layout, keys, {**here, **own, **common}))
    return Design(config, rows, plan, exploring)


def _unit(
    config: RobotBench,
    subject: str,
    task: Mapping[str, Any],
    arm: BenchArm,
    layout: int,
    by_profile: Mapping[str, str],
    factors: Mapping[str, str | int],
) -> EpisodeUnit:
    label = f"{config.planner.name}, {subject}, {arm.name}"
    keys = tuple(by_profile.values())
    return EpisodeUnit(keys, label, config, subject, task, arm, layout, by_profile, factors)


def _around(
    config: RobotBench, registry: Registry, rows: Mapping[str, Mapping[str, Any]]
) -> dict[str, tuple[Any, ...]]:
    """What all episodes of a row share that could change their outcome, by the row's name."""
    asking = ASKING_CODE if _model(config, registry) else ()
    tries = (config.replan, config.max_parts)
    found = {}
    for subject, task in rows.items():
        typed = configured(registry, components(config, task), (*LOOP, *GEOMETRY))
        options = (
            list(map(asdict, typed)),
            asdict(config.depth_noise),
            asdict(config.branch),
            tries,
            versions(),
        )
        found[subject] = (*options, code_of(typed, *MEASURING_CODE, *asking), VERSION)
    return found


def _memory_key(config: RobotBench, registry: Registry, arm: BenchArm) -> Any:
    if arm.source == "best_theta":
        return arm.source
    typed = configured(registry, chosen_memory(config, registry, arm, ""), MEMORY)
    return [arm.source, list(map(asdict, typed)), code_of(typed)]


def _model(config: RobotBench, registry: Registry) -> str:
    """The language model that the episode's components use; "" if none does."""
    kinds = [
        kind for kind in (*LOOP, *GEOMETRY) if kind != "task" and not registry.chooses_nothing(config, kind)
    ]
    if not any("language" in registry.configure(config, kind)[1].needs for kind in kinds):
        return ""
    return model_label(config.language)


def _places(config: RobotBench) -> list[tuple[dict[str, str | int], int]]:
    """The test's layouts, each with the seed and episode number it counts as.

    One that is named is the same episode as by its seed, where it has one. In a learnable world the seed is the
    world's.
    """
    if not config.layouts:
        return [
            ({"seed": seed, "episode": episode}, STRIDE * (seed + 1) + episode)
            for seed in dict.fromkeys(config.seeds)
            for episode in range(config.episodes)
        ]
    found: list[tuple[dict[str, str | int], int]] = []
    for layout in dict.fromkeys(config.layouts):
        place: dict[str, str | int] = {"seed": layout // STRIDE - 1, "episode": layout % STRIDE}
        if config.world == LEARNABLE:
            place = {"seed": config.seeds[0], "episode": f"{NAMED} {layout}"}
        elif layout < STRIDE:
            place = {"seed": NAMED, "episode": layout}
        found.append((place, layout))
    return found


def planner_label(config: RobotBench) -> str:
    """The planner in a table: its name, changed options, and fallback."""
    label = described(config.planner)
    return label if config.fallback.name in ("", NONE) else f"{label}, then {described(config.fallback)}"


def _common(config: RobotBench, registry: Registry) -> dict[str, str | int]:
    """The factors that all episodes of a design share: what is at work, without options that are as usual."""
    refined = config.reconstructor.name not in ("", NONE)
    also = {kind: getattr(config, kind) for kind in ("camera", *(GEOMETRY if refined else ()))}
    parts = [f"{kind} {described(one)}" for kind, one in also.items() if one.name not in ("", NONE)]
    optional: dict[str, str | int] = {
        "branch": config.branch.label() if config.branch.changed() else "",
        "world": config.world if config.world == LEARNABLE else "",
        "parts": ", ".join(parts),
        "replan": config.replan,
        "max_parts": config.max_parts if config.max_parts != RobotBench().max_parts else "",
    }
    return {
        **{kind: described(getattr(config, kind)) for kind in ("robot", "perceiver", "verifier")},
        "planner": planner_label(config),
        "model": _model(config, registry),
        "depth_noise": noise_label(config.depth_noise),
        "scale": str(config.scale),
        **{name: value for name, value in optional.items() if value},
    }


def _learning_label(config: RobotBench, arm: BenchArm) -> str:
    """What arms learn from and with in a table: the exploration, and what memory's helpers have changed."""
    usual, changed = RobotBench(), []
    if config.exploration_seeds != usual.exploration_seeds:
        changed.append(f"seeds {_ranged(config.exploration_seeds)}")
    for name in ("exploration", "exploration_replan"):
        if getattr(config, name) != getattr(usual, name):
            changed.append(f"{name}={getattr(config, name)}")
    if arm.source not in WITHOUT_BANK:
        for kind in MEMORY[1:]:
            helper = getattr(config, kind)
            if helper.name and described(helper) != KINDS[kind].default:
                changed.append(f"{kind} {described(helper)}")
    return ", ".join(changed)


def _ranged(numbers: Iterable[int]) -> str:
    """Numbers in few words: "0-3, 7"."""
    spans: list[list[int]] = []
    for number in sorted(set(numbers)):
        if spans and spans[-1][-1] == number - 1:
            spans[-1].append(number)
        else:
            spans.append([number])
    return ", ".join(f"{one[0]}-{one[-1]}" if len(one) > 1 else str(one[0]) for one in spans)
