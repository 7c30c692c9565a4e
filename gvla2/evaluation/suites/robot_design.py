"""The robot suite's design: its episodes, what identifies them, and what they have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

from gvla2.component import described
from gvla2.errors import ConfigurationError
from gvla2.evaluation.arms import MEMORY, BenchArm, chosen_arms, chosen_memory
from gvla2.evaluation.components import (
    changed_options,
    code_of,
    configured,
    given_label,
    model_label,
    named_tasks,
    noise_label,
    options_of,
    require_among,
)
from gvla2.evaluation.config import LEARNABLE, RobotBench
from gvla2.evaluation.results import cell_key, versions
from gvla2.evaluation.suites.robot_conditions import (
    SCANNED,
    condition_labels,
    conditioned,
    scans_of,
    sentences_of,
)
from gvla2.evaluation.suites.robot_episodes import EXPLORED, EpisodeUnit, chosen_components
from gvla2.evaluation.suites.robot_stress import in_world, lived, stresses_of
from gvla2.plugins.assembly import GEOMETRY, LOOP
from gvla2.plugins.kinds import KINDS, NONE, OWN_TASK
from gvla2.plugins.registry import Registry

SUITE = "robot"
VERSION = 2
"""The protocol's version: rows of another version are measured again."""
EXPLORATION = "robot_exploration"
"""The name under which the results database stores the arms' experience."""
PROFILES = ("relaxed", "strict")
TRUE_SCENE = "oracle"
"""The perceiver that reads the simulator's state."""
FAMILY = ", family "
"""Between a task and the number of a family in a row's name."""
STRIDE = 10_000
"""Layouts of one seed; those below it are for exploration and for layouts that are named."""
NAMED = "layouts"
"""The ``seed`` of episodes whose layouts were named and have no seed; ``episode`` is the layout then."""
TASKS = (
    "put_block", "play_jenga", "open_jar", "close_box", "open_box", "pickup_cup", "push_block", "take_umbrella",
    "sort_mustard", "open_wine", "lamp_on", "put_knife", "pick_and_lift", "insert_block",
)  # fmt: skip
"""The paper's tasks in its order, measured where none are named."""
SETTING = (
    "robot",
    "perceiver",
    "components",
    "branch",
    "verifier",
    "depth_noise",
    "scale",
    "distractors",
    "sentences",
    "world",
    "stress",
    "second_tries",
    "replan",
)
"""Factors that rows must share to be compared; tables leave out those with the usual value."""
MEASURING_CODE = (
    "gvla2.episode", "gvla2.evaluation.arms", "gvla2.evaluation.suites.robot", "gvla2.evaluation.suites.robot_episodes",
    "gvla2.evaluation.suites.robot_conditions", "gvla2.evaluation.suites.robot_stress", "gvla2.geometry",
    "gvla2.memory", "gvla2.perception", "gvla2.planning", "gvla2.plugins.assembly", "gvla2.reconstruction",
    "gvla2.robot", "gvla2.skills",
)  # fmt: skip
"""Code whose change outdates stored rows, besides the chosen plugins."""
ASKING_CODE = ("gvla2.language",)
"""The same, for rows that used a language model."""


@dataclass(frozen=True)
class Design:
    """The episodes in one world; ``config`` is the bench with that world alone.

    ``subjects`` are the rows: their names with the task's name and options.
    """

    config: RobotBench
    subjects: Mapping[str, Mapping[str, Any]]
    plan: Sequence[EpisodeUnit]
    exploring: Sequence[EpisodeUnit]


def world_of(config: RobotBench) -> str:
    """The name of a design's world: "plain", or "learnable" with its number and stress."""
    if config.world != LEARNABLE:
        return config.world
    return "-".join([config.world, str(config.seeds[0]), *config.stresses])


def designs(config: RobotBench, registry: Registry) -> list[Design]:
    """The bench's design; in a learnable world one for each seed, since each is a different world, explored anew, and
    for each stress.

    Raises :class:`ConfigurationError` for names and options that do not exist, and for a layout that exploration uses
    too.
    """
    arms = chosen_arms(config, registry)
    if config.policy.name not in ("", NONE) and any(arm.name != "off" for arm in arms):
        raise ConfigurationError("A policy has no memory: arms=[off].")
    if config.reconstructor.name in ("", NONE) and any(arm.geometry for arm in arms):
        raise ConfigurationError("Arms with a geometry need a reconstructor: reconstructor=hull.")
    _check_seeds(config, learns=any(arm.learns for arm in arms))
    seeds = [[seed] for seed in dict.fromkeys(config.seeds)] if config.world == LEARNABLE else [config.seeds]
    stresses = [[stress] for stress in dict.fromkeys(config.stresses)] or [[]]
    return [
        _design(replace(config, seeds=world, stresses=stress), registry, arms)
        for world, stress in product(seeds, stresses)
    ]


def _check_seeds(config: RobotBench, learns: bool) -> None:
    """Raises :class:`ConfigurationError` if exploration could use a test's layout, or would do nothing."""
    explored = config.exploration_seeds
    shared = sorted(set(explored) & set(config.layouts)) if learns else []
    if learns and not explored:
        raise ConfigurationError("exploration_seeds is empty, but there are arms that learn.")
    if config.episodes > STRIDE:
        raise ConfigurationError(f"episodes is {config.episodes}; {STRIDE} at most fit to one seed.")
    if not all(0 <= seed < STRIDE for seed in explored):
        raise ConfigurationError(
            f"exploration_seeds {explored} are not in [0, {STRIDE}): higher ones lay out the test."
        )
    if shared:
        raise ConfigurationError(
            f"layouts {shared} are among the exploration_seeds: an explored layout cannot be a test. Choose others."
        )


def subjects(config: RobotBench, registry: Registry) -> dict[str, dict[str, Any]]:
    """The rows of the bench in their order: each one's name, and the task's name and options.

    In a learnable world there is a row per family, and the world is that of the bench's first seed. Raises
    :class:`ConfigurationError` for options that a task does not have.
    """
    found: dict[str, dict[str, Any]] = {}
    scans = scans_of(config)
    names = ordered(named_tasks(config, registry) or _default_tasks(config, registry, scans))
    require_among("task_options", config.task_options, names, "tasks")
    world = {"world": LEARNABLE, "world_seed": config.seeds[0], "families": config.families}
    for name in names:
        options, label = conditioned(config, registry, name, scans), given_label(name, config.task_options)
        if config.world != LEARNABLE:
            found[label] = {"name": name, **options}
            continue
        if OWN_TASK in name or "family" not in options_of(registry, "task", name):
            raise ConfigurationError(f"world is {LEARNABLE}, but the task '{name}' has no option 'family'.")
        for family in range(config.families):
            task = in_world({"name": name, **options, **world, "family": family}, stresses_of(config))
            found[f"{label}{FAMILY}{family}"] = task
    return found


def _default_tasks(config: RobotBench, registry: Registry, scans: str) -> list[str]:
    """The paper's fourteen, and scanned objects if there are ``scans`` and nothing is scaled; in a learnable world all
    that have something to learn.
    """
    if config.world != LEARNABLE:
        return [*TASKS, *([SCANNED] if scans and config.scale == 1 else [])]

    def learnable(name: str) -> bool:
        if "family" not in options_of(registry, "task", name):
            return False
        try:
            registry.build({"task": {"name": name, "world": LEARNABLE}}, "task")
        except ConfigurationError:
            return False
        return True

    return list(filter(learnable, registry.components("task")))


def ordered(tasks: Sequence[str]) -> list[str]:
    """Each task once, the paper's first in its order."""
    chosen = list(dict.fromkeys(tasks))
    return [name for name in TASKS if name in chosen] + [name for name in chosen if name not in TASKS]


def _design(config: RobotBench, registry: Registry, arms: Sequence[BenchArm]) -> Design:
    """The episodes with their keys, which name everything that could change them."""
    rows = subjects(config, registry)
    past_rows = _explored(config, registry, rows)
    if any(arm.source == "shuffled" for arm in arms) and (len(rows) == 1 or past_rows != rows):
        raise ConfigurationError(
            "The arm 'shuffled' recalls for another tested task: name two tasks or more, and no exploration_tasks."
        )
    tested, exploration = replace(config, stresses=[]), lived(config, registry)
    around, world = _around(tested, registry, rows), world_of(config)
    explored = list(past_rows) if any(arm.learns for arm in arms) else []
    how = (config.exploration, config.exploration_replan)
    explorer = BenchArm(EXPLORED, "off", replan=config.exploration_replan)
    seeds = list(dict.fromkeys(config.exploration_seeds))
    half = len(seeds) // 2 if "drift" in stresses_of(config) else 0
    before = {name: {**task, "drifted": False} for name, task in past_rows.items()}
    exploring = []
    for some, then in [(seeds[:half], before)] * bool(half) + [(seeds[half:], past_rows)]:
        past_world = _around(exploration, registry, then)
        for subject, seed in product(explored, some):
            here: dict[str, str | int] = {"task": subject, "arm": EXPLORED, "seed": seed}
            keys: tuple[str, ...] = (cell_key(EXPLORATION, here, past_world[subject], *how),)
            factors = {**here, "planner": planner_label(exploration)}
            unit = EpisodeUnit(
                keys, f"{subject}, {EXPLORED}", exploration, subject, then[subject], explorer, seed, factors
            )
            exploring.append(replace(unit, world=world))
    lessons = (*config.stresses, [unit.keys for unit in exploring])
    common = _common(config, registry)
    plan = []
    for (subject, task), arm in product(rows.items(), arms):
        past: Any = (lessons, _memory_key(config, registry, arm)) if arm.learns else ()
        past = (past, arm.replan, arm.geometry, *config.stresses)
        own = {"variant": arm.variant} if arm.variant else {}
        own |= {"geometry": arm.geometry} if arm.geometry else {}
        own |= {"learning": _learning_label(config)} if arm.learns else {}
        for place, layout in _places(config):
            here = {"task": subject, "arm": arm.name, **place}
            keys = tuple(cell_key(SUITE, here, p, around[subject], past) for p in PROFILES)
            label, factors = f"{subject}, {arm.name}", {**here, **own, **common}
            plan.append(
                EpisodeUnit(keys, label, tested, subject, task, arm, layout, factors, PROFILES, world)
            )
    return Design(config, rows, plan, exploring)


def _explored(
    config: RobotBench, registry: Registry, rows: Mapping[str, Mapping[str, Any]]
) -> Mapping[str, Mapping[str, Any]]:
    """The rows that are explored: those of ``exploration_tasks``, or the tested ones."""
    if not config.exploration_tasks:
        return rows
    if config.world == LEARNABLE:
        raise ConfigurationError(
            f"The world {LEARNABLE} explores its own families: leave exploration_tasks out."
        )
    tasks = config.exploration_tasks
    options = {name: given for name, given in config.task_options.items() if name in tasks}
    return subjects(replace(config, tasks=tasks, task_options=options), registry)


def _around(
    config: RobotBench, registry: Registry, rows: Mapping[str, Mapping[str, Any]]
) -> dict[str, tuple[Any, ...]]:
    """What all episodes of a row share that could change their outcome, by the row's name."""
    asking = ASKING_CODE if _model(config, registry) else ()
    shared = (
        asdict(config.depth_noise),
        asdict(config.branch),
        config.second_tries,
        config.replan,
        versions(),
    )
    found = {}
    for subject, task in rows.items():
        kinds = [kind for kind in (*LOOP, *GEOMETRY) if kind != "task" or OWN_TASK not in task["name"]]
        typed = configured(registry, chosen_components(config, task), kinds)
        code = code_of(typed, *MEASURING_CODE, *asking)
        said = sentences_of(config, task["name"])
        found[subject] = (list(map(asdict, typed)), *shared, *said, code, VERSION)
    return found


def _memory_key(config: RobotBench, registry: Registry, arm: BenchArm) -> Any:
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
    """The planner in a table: its name, changed options, and fallback; or the policy that drives instead."""
    if config.policy.name not in ("", NONE):
        return described(config.policy)
    label = described(config.planner)
    return label if config.fallback.name in ("", NONE) else f"{label}, then {described(config.fallback)}"


def _common(config: RobotBench, registry: Registry) -> dict[str, str | int]:
    """The factors that all episodes of a design share; those with the usual value are left out."""
    refined = config.reconstructor.name not in ("", NONE)
    also = {kind: getattr(config, kind) for kind in ("camera", *(GEOMETRY if refined else ()))}
    components = [f"{kind} {described(one)}" for kind, one in also.items() if one.name not in ("", NONE)]
    optional: dict[str, str | int] = {
        "branch": config.branch.label() if config.branch.changed() else "",
        "world": config.world if config.world == LEARNABLE else "",
        "stress": next(iter(config.stresses), ""),
        "components": ", ".join(components),
        "replan": config.replan,
        **condition_labels(config),
        "second_tries": "" if config.second_tries == RobotBench.second_tries else str(config.second_tries),
    }
    return {
        **{kind: described(getattr(config, kind)) for kind in ("robot", "perceiver", "verifier")},
        "planner": planner_label(config),
        "model": _model(config, registry),
        "given": _given(config),
        "depth_noise": noise_label(config.depth_noise),
        "scale": str(config.scale),
        **{name: value for name, value in optional.items() if value},
    }


def _given(config: RobotBench) -> str:
    """What the robot perceives by, which a reader must know before comparing: the simulator's own objects, known
    meshes, or neither.
    """
    if config.perceiver.name == TRUE_SCENE:
        return "true scene: no perception, a diagnosis"
    if config.policy.name not in ("", NONE):
        return f"{len(getattr(config.robot, 'cameras', ()))} cameras, a trained policy"
    known = "known objects (meshes)" if getattr(config.perceiver, "gallery", "") else "no gallery"
    return f"{len(getattr(config.robot, 'cameras', ()))} cameras with depth, {known}, no training"


def _learning_label(config: RobotBench) -> str:
    """How arms learn, where it is unusual: the exploration, and the components that memories use."""
    how = [name for name in vars(config) if name.startswith("exploration")]
    exploring = changed_options(config, how)
    helpers = {kind: getattr(config, kind) for kind in MEMORY[1:]}
    unusual = [
        f"{kind} {described(one)}"
        for kind, one in helpers.items()
        if one.name and described(one) != KINDS[kind].default
    ]
    return ", ".join(filter(None, (exploring, *unusual)))
