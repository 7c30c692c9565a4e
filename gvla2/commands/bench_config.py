"""The schema of `gvla2 bench`: what is measured, on what, and where the numbers go."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from gvla2.commands.run_config import ResultsConfig
from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError
from gvla2.reconstruction.options import BranchOptions
from gvla2.robot.options import DepthNoise


@dataclass
class DataConfig:
    """The objects to measure on.

    ``root`` is the data set's folder (searched for by default, see ``gvla2 data``); ``objects`` chooses some by name,
    in this order; ``size`` is the pictures' side in pixels and ``samples`` the rays along a pixel's side when meshes
    are rendered: the protocol's are 256 and 4.
    """

    kind: str = "ycb30"
    root: str | None = None
    objects: list[str] = field(default_factory=list)
    size: int = 256
    samples: int = 4

    def __post_init__(self) -> None:
        if not 32 <= self.size <= 4096 or not 1 <= self.samples <= 16:
            raise ConfigurationError("data.size lies in [32, 4096] and data.samples in [1, 16].")


@dataclass
class MemoryBenchConfig:
    """The memory suite: its ``tests`` by name (all by default), at a ``scale`` in (0, 1] of their sizes.

    ``folder`` holds temporary databases, on the disk to be measured (by default the output folder); ``seed`` makes the
    random lessons.
    """

    tests: list[str] = field(default_factory=list)
    scale: float = 1.0
    folder: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.scale <= 1:
            raise ConfigurationError(f"memory.scale is {self.scale}; it lies above 0 and is 1 at most.")
        if self.seed < 0:
            raise ConfigurationError("memory.seed must not be negative.")


@dataclass
class AgentsBenchConfig:
    """The agents suite: ``tasks`` is a folder of tasks in Terminal-Bench's layout, of which ``names`` chooses some.

    ``sandbox`` is bubblewrap or docker; a task may fill ``disk_mb`` and a process ``memory_mb``, and ``output``
    characters of a command's output are kept. ``state`` is where memories are stored between the tasks (by default in
    the output folder: give one to resume an interrupted bench). The suite ``trajectories`` reads a folder of published
    runs with known outcomes instead, ``trajectories``, of which ``most`` are judged and learnt from.
    """

    tasks: str = ""
    names: list[str] = field(default_factory=list)
    sandbox: str = "bubblewrap"
    disk_mb: int = 512
    memory_mb: int = 4096
    output: int = 8000
    state: str = ""
    trajectories: str = ""
    most: int = 200

    def __post_init__(self) -> None:
        if self.sandbox not in ("bubblewrap", "docker"):
            raise ConfigurationError(f"agents.sandbox is '{self.sandbox}'; it is bubblewrap or docker.")
        if self.disk_mb < 1 or self.memory_mb < 64 or self.output < 200 or self.most < 1:
            raise ConfigurationError(
                "agents.disk_mb is at least 1, memory_mb 64, output 200 characters and most 1."
            )


@dataclass
class BenchConfig:
    """One benchmark. Of the suite ``reconstruction``: every baseline x drift x noise x variant x seed on every object;
    ``noise`` is the depth prior's error, by name.

    ``baseline_options`` configures reconstructors by name (``baseline_options.splat.iterations=200``); ``branch``
    holds the branch's options; ``lpips_weights`` is a weight file of your own; ``surface_samples`` points of a surface
    make its Chamfer distance (the protocol's 100,000); ``workers`` processes share the objects, 0 for one a core (8 at
    most); ``quiet`` leaves only the table on the terminal. The suite ``memory`` uses only ``memory``, ``results`` and
    ``data.root``.

    Of the suite ``robot``: every task x planner x arm x layout, judged by both profiles. ``tasks`` are the paper's
    fourteen by default, in a learnable world those with something to learn; ``planners`` compares some by name (by
    default the one of ``planner``), with ``planner_options`` by theirs (``planner_options.code_policies.samples=3``).
    ``arms`` are ``off``, ``on``, ``shuffled``, ``best_theta``, or the name of any memory: by default ``off`` alone
    where ``planners`` are named, else these four and ``semantic``. An arm may also be a variant with a name of its own
    and options (``arms.mine={memory: governed, admission: false}``, ``arms.retry={memory: off, replan: 1}``), a plain
    one can have options by its name (``arms.on.admission=false``), as can a task (``task_options.open_jar.turn=175``).
    In the ``world`` learnable every task's things belong to ``families`` that each behave in their own way
    (docs/learnable_worlds.md), and each seed is a different world. Each of ``seeds`` lays out ``episodes``, or
    ``layouts`` names the seeds of the layouts themselves. Experience comes from ``exploration_seeds``, where each
    planner, or the ``teacher`` for all of them, varies its plans by ``exploration`` (a relative spread, or a model's
    temperature), and is frozen before the test; it may try again ``exploration_replan`` times in an episode. ``replan``
    further attempts are allowed in an episode of the test and ``max_parts`` plans in each; where the planner fails,
    ``fallback`` plans, if there is one. With ``planner_timeout`` > 0 (seconds), an episode whose planner takes longer
    is not measured, nor is one whose language model was unavailable: it counts for no arm, and the next bench
    measures it again. ``scale`` is the objects' size; ``videos`` failed episodes of each task and arm are run
    once more with the camera on.

    Of the suite ``agents``: every task of ``agents.tasks`` in the order of each of ``seeds``, with each memory of
    ``arms`` (by default off, awm, reasoning_bank and governed); ``agent`` works, ``verifier`` judges.

    Of the suite ``perception``: every task x perceiver of ``perceivers`` x layout, ``episodes`` layouts for each of
    ``seeds``; ``tasks`` are all that need no option by default, ``scale`` and ``depth_noise`` as above.
    """

    suite: str = "reconstruction"
    data: DataConfig = field(default_factory=DataConfig)
    baselines: list[str] = field(default_factory=lambda: ["hull", "splat"])
    baseline_options: dict[str, Any] = field(default_factory=dict)
    drifts: list[str] = field(default_factory=lambda: ["none", "planted"])
    variants: list[str] = field(default_factory=list)
    noise: list[str] = field(default_factory=lambda: ["exact"])
    seeds: list[int] = field(default_factory=lambda: [0])
    branch: BranchOptions = field(default_factory=BranchOptions)
    prior: ComponentConfig = field(default_factory=ComponentConfig)
    axis: ComponentConfig = field(default_factory=ComponentConfig)
    fusion: ComponentConfig = field(default_factory=ComponentConfig)
    renderer: ComponentConfig = field(default_factory=ComponentConfig)
    lpips_weights: str | None = None
    memory: MemoryBenchConfig = field(default_factory=MemoryBenchConfig)
    agents: AgentsBenchConfig = field(default_factory=AgentsBenchConfig)
    agent: ComponentConfig = field(default_factory=ComponentConfig)
    results: ResultsConfig = field(default_factory=ResultsConfig)
    tasks: list[str] = field(default_factory=list)
    planners: list[str] = field(default_factory=list)
    planner_options: dict[str, Any] = field(default_factory=dict)
    teacher: str = ""
    arms: list[str] | None = None
    own_arms: dict[str, Any] = field(default_factory=dict)
    world: str = "plain"
    families: int = 2
    task_options: dict[str, Any] = field(default_factory=dict)
    exploration_replan: int = 0
    episodes: int = 25
    layouts: list[int] = field(default_factory=list)
    exploration_seeds: list[int] = field(default_factory=lambda: list(range(10)))
    exploration: float = 0.25
    replan: int = 0
    max_parts: int = 6
    planner_timeout: float = 0.0
    scale: float = 1.0
    videos: int = 1
    perceivers: list[str] = field(default_factory=lambda: ["classical"])
    depth_noise: DepthNoise = field(default_factory=DepthNoise)
    robot: ComponentConfig = field(default_factory=ComponentConfig)
    camera: ComponentConfig = field(default_factory=ComponentConfig)
    perceiver: ComponentConfig = field(default_factory=ComponentConfig)
    reconstructor: ComponentConfig = field(default_factory=ComponentConfig)
    planner: ComponentConfig = field(default_factory=ComponentConfig)
    fallback: ComponentConfig = field(default_factory=ComponentConfig)
    verifier: ComponentConfig = field(default_factory=ComponentConfig)
    retriever: ComponentConfig = field(default_factory=ComponentConfig)
    embedder: ComponentConfig = field(default_factory=ComponentConfig)
    inducer: ComponentConfig = field(default_factory=ComponentConfig)
    judge: ComponentConfig = field(default_factory=ComponentConfig)
    language: ComponentConfig = field(default_factory=ComponentConfig)
    surface_samples: int = 100_000
    workers: int = 0
    quiet: bool = False

    def __post_init__(self) -> None:
        lists = ("baselines", "drifts", "noise", "seeds", "perceivers", "arms")
        empty = [
            name for name in lists if not getattr(self, name) and (name != "arms" or not self.chosen_arms)
        ]
        counts = ("workers", "videos", "replan", "exploration_replan")
        below = [name for name in counts if getattr(self, name) < 0]
        below += [name for name in ("seeds", "layouts") if min(getattr(self, name), default=0) < 0]
        for holds, what in (
            (self.world in ("plain", "learnable"), f"world is '{self.world}'; it is plain or learnable."),
            (not empty, f"{', '.join(empty)} must name at least one."),
            (not below, f"{', '.join(below)} must not be negative."),
            (self.surface_samples >= 100, "surface_samples must be at least 100."),
            (min(self.families, self.episodes, self.max_parts) >= 1, "families, episodes, max_parts are 1 or more."),
            (0 <= self.planner_timeout < math.inf, "planner_timeout is in seconds, finite, not negative (0: off)."),
            (0.25 <= self.scale <= 4, "scale lies in [0.25, 4]."),
            (0 <= self.exploration <= 1, "exploration lies in [0, 1]."),
        ):  # fmt: skip
            if not holds:
                raise ConfigurationError(what)

    @property
    def chosen_arms(self) -> list[str]:
        """The arms, each once."""
        usual = ["off"] if self.planners else ["off", "on", "shuffled", "semantic", "best_theta"]
        return list(dict.fromkeys([*usual, *map(str, self.own_arms)] if self.arms is None else self.arms))
