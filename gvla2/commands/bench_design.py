"""The robot suite's design: each planner's episodes, what identifies them, and what they have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

from gvla2.commands.bench_arms import (
    MEMORY,
    WITHOUT_BANK,
    BenchArm,
    arms_of,
    check_arms,
    chosen_memory,
    configured,
)
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_episodes import EXPLORED, Planned, chosen_parts
from gvla2.commands.bench_frame import (
    code_of,
    given_options,
    model_label,
    noise_label,
    options_of,
    require_among,
)
from gvla2.commands.bench_subjects import LEARNABLE, subjects
from gvla2.commands.run import GEOMETRY, LOOP
from gvla2.component import ComponentConfig, described
from gvla2.errors import ConfigurationError
from gvla2.evaluation.provenance import versions
from gvla2.evaluation.results import cell_key
from gvla2.evaluation.robot.design import (
    EXPLORATION,
    NAMED,
    PROFILES,
    STRIDE,
    SUITE,
    VERSION,
    check_seeds,
    layout_seed,
    stand_in,
)
from gvla2.plugins.kinds import KINDS, NONE
from gvla2.plugins.registry import Registry, nothing_in

MEASURING_CODE = (
    "gvla2.episode",
    "gvla2.evaluation.robot.arms",
    "gvla2.evaluation.robot.design",
    "gvla2.evaluation.robot.experience",
    "gvla2.geometry",
    "gvla2.memory",
    "gvla2.perception",
    "gvla2.planning",
    "gvla2.programs",
    "gvla2.reconstruction",
    "gvla2.robot",
    "gvla2.skills",
)
"""Code whose change outdates stored rows, besides the chosen plugins."""
ASKING_CODE = ("gvla2.language",)
"""The same, for rows that used a language model."""


@dataclass(frozen=True)
class PlannerDesign:
    """One planner's episodes; ``config`` is the bench with it. Another planner may be the one that explores."""

    config: BenchConfig
    tasks: Sequence[str]
    plan: Sequence[Planned]
    exploring: Sequence[Planned]

    @property
    def place(self) -> str:
        """A folder name unique among the designs of the bench."""
        world = f"-world{self.config.seeds[0]}" if self.config.world == LEARNABLE else ""
        return f"{self.config.planner.name}{world}"


def designs(config: BenchConfig, registry: Registry) -> list[PlannerDesign]:
    """A design for each planner of the bench, all over the same tasks, arms and layouts.

    In a learnable world a planner has one for each seed, since each is a different world, explored anew.

    Raises :class:`ConfigurationError` for names and options that do not exist, and for a layout that exploration uses
    too.
    """
    tasks = list(subjects(config, registry))
    explored = _explored_tasks(config, tasks)
    _check_learning(config, bool(explored))
    check_seeds(config.episodes, config.exploration_seeds, config.layouts if explored else ())
    planners = list(dict.fromkeys(config.planners)) or [config.planner.name]
    others = [config.teacher] if config.teacher else []
    require_among("planner_options", config.planner_options, [*planners, *others], "planners")
    check_arms(config, registry)
    worlds = [replace(config, seeds=[seed]) for seed in dict.fromkeys(config.seeds)]
    found = []
    for world in worlds if config.world == LEARNABLE else [config]:
        teacher = with_planner(world, registry, config.teacher) if config.teacher else None
        for name in planners:
            bench = with_planner(world, registry, name)
            found.append(_design(bench, teacher or bench, registry, tasks, explored))
    return found


def _check_learning(config: BenchConfig, learns: bool) -> None:
    """Raises :class:`ConfigurationError` for options of learning that would do nothing, or nothing to learn from."""
    for holds, what in (
        (learns or not config.teacher, f"teacher is '{config.teacher}', but no arm learns."),
        (
            config.exploration_seeds or not learns,
            "exploration_seeds is empty, but there are arms that learn.",
        ),
        (
            config.world == LEARNABLE or config.families == BenchConfig().families,
            f"families is {config.families}; there are families in world={LEARNABLE} only.",
        ),
    ):
        if not holds:
            raise ConfigurationError(what)


def with_planner(config: BenchConfig, registry: Registry, name: str) -> BenchConfig:
    """The bench with one of its planners, configured; a planner is not its own fallback."""
    registry.get("planner", name)
    place, known = f"planner_options.{name}", options_of(registry, "planner", name)
    given = given_options(place, config.planner_options.get(name) or {}, f"the planner '{name}'", known)
    own = config.planner if config.planner.name == name else None
    base = {"name": name} if own is None else asdict(own)
    planner = own if own and not given else registry.configure({"planner": {**base, **given}}, "planner")[0]
    fallback = ComponentConfig(name=NONE) if config.fallback.name == name else config.fallback
    return replace(config, planner=planner, fallback=fallback)


def planner_label(config: BenchConfig) -> str:
    """The planner in a table: its name, changed options, and fallback."""
    label = described(config.planner)
    helped = config.fallback.name not in ("", NONE)
    return f"{label}, then {described(config.fallback)}" if helped else label


def _parts_label(config: BenchConfig) -> str:
    """What else is at work in a table: the camera, and where objects are refined what does that; "" for nothing."""
    refined = config.reconstructor.name not in ("", NONE)
    kinds = ("camera", *(GEOMETRY if refined else ()))
    chosen = {kind: getattr(config, kind) for kind in kinds}
    return ", ".join(f"{kind} {described(one)}" for kind, one in chosen.items() if one.name not in ("", NONE))


def _learning_label(config: BenchConfig, arm: BenchArm) -> str:
    """What arms learn from and with in a table: the exploration, and what memory's helpers have changed."""
    usual = BenchConfig()
    told = (
        []
        if config.exploration_seeds == usual.exploration_seeds
        else [f"seeds {_ranged(config.exploration_seeds)}"]
    )
    told += [
        f"{name}={getattr(config, name)}"
        for name in ("exploration", "exploration_replan")
        if getattr(config, name) != getattr(usual, name)
    ]
    if arm.source not in WITHOUT_BANK:
        helpers = {kind: getattr(config, kind) for kind in MEMORY[1:]}
        told += [
            f"{kind} {described(one)}"
            for kind, one in helpers.items()
            if one.name and described(one) != KINDS[kind].default
        ]
    return ", ".join(told)


def _ranged(numbers: Sequence[int]) -> str:
    """Numbers in few words: "0-3, 7"."""
    parts: list[list[int]] = []
    for number in sorted(set(numbers)):
        if parts and parts[-1][-1] == number - 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(f"{one[0]}-{one[-1]}" if len(one) > 1 else str(one[0]) for one in parts)


def _explored_tasks(config: BenchConfig, tasks: Sequence[str]) -> list[str]:
    """The tasks from which some arm needs experience."""
    sources = {arm.source for arm in arms_of(config)}
    if sources <= {"off", "none"}:
        return []
    others = [stand_in(task, tasks) for task in tasks] if "shuffled" in sources else []
    return list(dict.fromkeys([*tasks, *others]))


def _design(
    config: BenchConfig,
    teaching: BenchConfig,
    registry: Registry,
    tasks: Sequence[str],
    explored: Sequence[str],
) -> PlannerDesign:
    around, taught = _around(config, registry, tasks), _around(teaching, registry, explored)
    how = (config.exploration, config.exploration_replan)
    explorer = BenchArm(EXPLORED, "off", replan=config.exploration_replan)
    exploring = []
    for task, seed in product(explored, dict.fromkeys(config.exploration_seeds)):
        here: dict[str, str | int] = {"task": task, "arm": EXPLORED, "seed": seed}
        key = cell_key(EXPLORATION, here, taught[task], *how)
        factors = {**here, "planner": planner_label(teaching)}
        exploring.append(Planned(teaching, task, explorer, seed, {"both": key}, factors))
    learnt = (list(explored), config.exploration_seeds, *how, [taught[task] for task in explored])
    common: dict[str, str | int] = {
        **{kind: described(getattr(config, kind)) for kind in ("robot", "perceiver", "verifier")},
        "planner": planner_label(config),
        "model": _model(config, registry),
        "depth_noise": noise_label(config.depth_noise),
        "scale": str(config.scale),
        **({"branch": config.branch.label()} if config.branch.changed() else {}),
        **({"world": config.world} if config.world == LEARNABLE else {}),
        **({"parts": parts} if (parts := _parts_label(config)) else {}),
        **({"replan": config.replan} if config.replan else {}),
        **({"max_parts": config.max_parts} if config.max_parts != BenchConfig().max_parts else {}),
    }
    teacher = planner_label(teaching) if planner_label(teaching) != planner_label(config) else ""
    arms = [(arm, _memory_key(config, registry, arm)) for arm in arms_of(config)]
    plan = []
    for task, (arm, memory) in product(tasks, arms):
        past: Any = () if arm.source in ("off", "none") else (learnt, memory)
        told = {"teacher": teacher, "learning": _learning_label(config, arm)} if past else {"teacher": ""}
        told |= {"variant": arm.variant} if arm.variant else {}
        if arm.replan is not None or arm.explored is not None:
            past = (past, arm.replan, arm.explored)
        for place, layout in _places(config):
            here = {"task": task, "arm": arm.name, **place}
            keys = {p: cell_key(SUITE, here, p, around[task], past) for p in PROFILES}
            plan.append(Planned(config, task, arm, layout, keys, {**here, **told, **common}))
    return PlannerDesign(config, tasks, plan, exploring)


def _around(config: BenchConfig, registry: Registry, tasks: Sequence[str]) -> dict[str, Any]:
    """What all episodes of a task share that could change their outcome, by task."""
    asking = ASKING_CODE if _model(config, registry) else ()
    tries = (config.replan, config.max_parts)
    found = {}
    for task in tasks:
        typed = configured(registry, chosen_parts(config, registry, task), (*LOOP, *GEOMETRY))
        told = (
            list(map(asdict, typed)),
            asdict(config.depth_noise),
            asdict(config.branch),
            tries,
            versions(),
        )
        found[task] = (*told, code_of(typed, *MEASURING_CODE, *asking), VERSION)
    return found


def _model(config: BenchConfig, registry: Registry) -> str:
    """The language model that the loop's components ask; "" if none does."""
    kinds = [kind for kind in (*LOOP, *GEOMETRY) if kind != "task" and not nothing_in(config, kind)]
    if not any("language" in registry.configure(config, kind)[1].needs for kind in kinds):
        return ""
    return model_label(config.language)


def _places(config: BenchConfig) -> list[tuple[dict[str, str | int], int]]:
    """The test's layouts, each with the seed and episode number it counts as.

    One that is named is the same episode as by its seed, where it has one.
    """
    if config.layouts:
        return [(_place_of(layout, config), layout) for layout in dict.fromkeys(config.layouts)]
    return [
        ({"seed": seed, "episode": episode}, layout_seed(seed, episode))
        for seed in dict.fromkeys(config.seeds)
        for episode in range(config.episodes)
    ]


def _place_of(layout: int, config: BenchConfig) -> dict[str, str | int]:
    if config.world == LEARNABLE:  # whose seed is the world's
        return {"seed": config.seeds[0], "episode": f"{NAMED} {layout}"}
    if layout < STRIDE:
        return {"seed": NAMED, "episode": layout}
    return {"seed": layout // STRIDE - 1, "episode": layout % STRIDE}


def _memory_key(config: BenchConfig, registry: Registry, arm: BenchArm) -> Any:
    if arm.source in ("off", "best_theta"):
        return arm.source
    typed = configured(registry, chosen_memory(config, registry, arm, ""), MEMORY)
    return [arm.source, list(map(asdict, typed)), code_of(typed)]
