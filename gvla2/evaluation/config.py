"""The options of ``gvla2 bench``: those of every suite, and a dataclass of each suite's own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError
from gvla2.reconstruction.options import BranchOptions
from gvla2.robot.options import DepthNoise

LEARNABLE = "learnable"
"""The ``world`` in which objects behave in ways that memory can learn."""


STRESSES = ("verifier", "drift", "import", "crowd", "twins", "unjudged")
"""What makes a world hard for a memory (:mod:`gvla2.evaluation.suites.robot_stress`); "all" are the first five."""


def _require(*conditions: tuple[bool, str]) -> None:
    """Raises :class:`ConfigurationError` with the message of the first condition that does not hold."""
    for holds, message in conditions:
        if not holds:
            raise ConfigurationError(message)


@dataclass
class ResultsConfig:
    """The results database: an SQLAlchemy address. ``fresh`` measures existing results again."""

    url: str = "sqlite:///outputs/results.sqlite"
    fresh: bool = False


@dataclass
class BenchConfig:
    """What every suite takes.

    ``seeds`` repeat the measurement; ``workers`` processes share it, 0 for one per core (8 at most); ``quiet`` leaves
    only the table on the terminal. ``suite`` is chosen by the Hydra group ``bench_suite``.
    """

    suite: str = ""
    seeds: list[int] = field(default_factory=lambda: [0])
    results: ResultsConfig = field(default_factory=ResultsConfig)
    workers: int = 0
    quiet: bool = False

    def __post_init__(self) -> None:
        _require(
            (bool(self.seeds), "seeds must name at least one."),
            (min(self.seeds, default=0) >= 0, "seeds must not be negative."),
            (self.workers >= 0, "workers must not be negative."),
        )


@dataclass
class DataConfig:
    """The objects to measure on.

    ``root`` is the data set's folder (searched for by default, see ``gvla2 doctor``); ``objects`` chooses some by name,
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
class BranchBench(BenchConfig):
    """What suites with the reconstruction branch share: its options and its components."""

    branch: BranchOptions = field(default_factory=BranchOptions)
    prior: ComponentConfig = field(default_factory=ComponentConfig)
    axis: ComponentConfig = field(default_factory=ComponentConfig)
    fusion: ComponentConfig = field(default_factory=ComponentConfig)
    renderer: ComponentConfig = field(default_factory=ComponentConfig)


@dataclass
class ReconstructionBench(BranchBench):
    """Every baseline x drift x noise x variant x seed on every object.

    ``baseline_options`` configures reconstructors by name (``baseline_options.hull.resolution=64``); ``noise`` is the
    depth prior's error, by name; ``surface_samples`` points of a
    surface make its Chamfer distance (the protocol's 100,000).
    """

    suite: str = "reconstruction"
    data: DataConfig = field(default_factory=DataConfig)
    baselines: list[str] = field(default_factory=lambda: ["hull"])
    baseline_options: dict[str, Any] = field(default_factory=dict)
    drifts: list[str] = field(default_factory=lambda: ["none", "planted"])
    variants: list[str] = field(default_factory=list)
    noise: list[str] = field(default_factory=lambda: ["exact"])
    surface_samples: int = 100_000

    def __post_init__(self) -> None:
        super().__post_init__()
        empty = [name for name in ("baselines", "drifts", "noise") if not getattr(self, name)]
        _require(
            (not empty, f"{', '.join(empty)} must name at least one."),
            (self.surface_samples >= 100, "surface_samples must be at least 100."),
        )


@dataclass
class MemoryArms(BenchConfig):
    """Arms that differ in their memory, with the components that memories use.

    ``arms`` are ``off``, ``on``, ``shuffled``, or the name of any memory. An arm may also be a variant
    with a name of its own and options (``arms.mine={memory: governed, failures: false}``, ``arms.retry={memory: off,
    replan: 1}``), and a plain one can have options by its name (``arms.on.failures=false``).
    """

    arms: list[str] | None = None
    own_arms: dict[str, Any] = field(default_factory=dict)
    verifier: ComponentConfig = field(default_factory=ComponentConfig)
    retriever: ComponentConfig = field(default_factory=ComponentConfig)
    embedder: ComponentConfig = field(default_factory=ComponentConfig)
    inducer: ComponentConfig = field(default_factory=ComponentConfig)
    judge: ComponentConfig = field(default_factory=ComponentConfig)
    language: ComponentConfig = field(default_factory=ComponentConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        _require((bool(self.chosen_arms), "arms must name at least one."))

    @property
    def usual_arms(self) -> list[str]:
        """The arms where none are named."""
        return ["off", "awm", "reasoning_bank", "governed"]

    @property
    def chosen_arms(self) -> list[str]:
        """The arms, each once."""
        named = [*self.usual_arms, *map(str, self.own_arms)] if self.arms is None else self.arms
        return list(dict.fromkeys(named))


@dataclass
class RobotBench(MemoryArms, BranchBench):
    """Every task x arm x layout, judged by both profiles.

    ``tasks`` are the paper's fourteen by default, in a learnable world those with something to learn; ``task_options``
    go by their names (``task_options.open_jar.turn=175``), ``scale`` is the objects' size. Beside the objects lie
    ``distractors``; ``sentences`` are the tasks' "own" or, drawn by the layout, "unseen" ones by strangers, where there
    are some; with ``scans``, a folder of meshes or "auto" for YCB-30 if it is installed, the task of scanned objects
    joins the default ones. The Hydra group ``conditions`` sets these three and the cameras: everyday, or clean.
    ``arms`` are by default ``off``, ``on``, ``shuffled`` and ``semantic``. In the ``world`` learnable the objects of
    every task belong to ``families`` that each behave in their own way (docs/learnable_worlds.md), and each seed is a
    different world. There the arms are measured under each of ``stresses``: "none", "verifier", "drift", "import",
    "crowd", "twins", "unjudged", some of them joined by "+", or "all". Each of ``seeds`` lays out ``episodes``, or
    ``layouts`` names the seeds of the layouts themselves.

    Experience comes from the layouts ``exploration_seeds`` of ``exploration_tasks`` (the tested ones, unless others are
    named), where the planner, or the ``exploration_planner`` of that name with its defaults, varies its plans by
    ``exploration`` (a relative spread, or a model's temperature) and may try again ``exploration_replan`` times in an
    episode; it is frozen before the test. In an episode of the test the hand tries again what it missed or lost, up to
    ``second_tries`` times, and ``replan`` further attempts are allowed; where the planner fails, ``fallback`` plans, if
    there is one. With ``planner_timeout`` > 0 (seconds), an episode whose planner takes longer is not measured, nor is
    one whose language model was unavailable: it counts for no arm, and the next bench measures it again. The
    reconstruction branch runs where a ``reconstructor`` is chosen. A ``policy`` stands beside planners in the tables;
    its arm is ``off``.

    ``films`` are kept of "none" of the test's episodes, of "failures", or of "all": each is the folder of a run. Tasks
    named SUITE/NUMBER are also counted by suite and by ``groups`` of suites, beside ``published`` results: by system,
    what it was ``given`` and its ``success`` in per cent by suite or group.
    """

    suite: str = "robot"
    tasks: list[str] = field(default_factory=list)
    task_options: dict[str, Any] = field(default_factory=dict)
    episodes: int = 25
    scale: float = 1.0
    distractors: int = 0
    sentences: str = "own"
    scans: str = "none"
    depth_noise: DepthNoise = field(default_factory=DepthNoise)
    robot: ComponentConfig = field(default_factory=ComponentConfig)
    camera: ComponentConfig = field(default_factory=ComponentConfig)
    perceiver: ComponentConfig = field(default_factory=ComponentConfig)
    world: str = "plain"
    families: int = 2
    stresses: list[str] = field(default_factory=list)
    layouts: list[int] = field(default_factory=list)
    exploration_tasks: list[str] = field(default_factory=list)
    exploration_planner: str = ""
    exploration_seeds: list[int] = field(default_factory=lambda: list(range(10)))
    exploration: float = 0.25
    exploration_replan: int = 0
    second_tries: int = 2
    replan: int = 0
    planner_timeout: float = 0.0
    films: str = "none"
    groups: dict[str, list[str]] = field(default_factory=dict)
    published: dict[str, Any] = field(default_factory=dict)
    planner: ComponentConfig = field(default_factory=ComponentConfig)
    fallback: ComponentConfig = field(default_factory=ComponentConfig)
    policy: ComponentConfig = field(default_factory=ComponentConfig)
    reconstructor: ComponentConfig = field(default_factory=ComponentConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        named = [one for stress in self.stresses for one in stress.split("+")]
        unknown = [one for one in named if one not in (*STRESSES, "none", "all")]
        counts = ("second_tries", "replan", "exploration_replan", "distractors")
        below = [name for name in counts if getattr(self, name) < 0]
        _require(
            (self.world in ("plain", LEARNABLE), f"world is '{self.world}'; it is plain or {LEARNABLE}."),
            (self.films in ("none", "failures", "all"), f"films is '{self.films}'; it is none, failures or all."),
            (self.sentences in ("own", "unseen"), f"sentences is '{self.sentences}'; it is own or unseen."),
            (not below, f"{', '.join(below)} must not be negative."),
            (not unknown, f"stresses has {', '.join(unknown)}; there are none, {', '.join(STRESSES)} and all."),
            (not self.stresses or self.world == LEARNABLE, f"stresses need world={LEARNABLE}."),
            (min(self.layouts, default=0) >= 0, "layouts must not be negative."),
            (min(self.episodes, self.families) >= 1, "episodes and families are 1 or more."),
            (0.25 <= self.scale <= 4, "scale lies in [0.25, 4]."),
            (0 <= self.planner_timeout < math.inf, "planner_timeout is in seconds, finite, not negative (0: off)."),
            (0 <= self.exploration <= 1, "exploration lies in [0, 1]."),
        )  # fmt: skip

    @property
    def usual_arms(self) -> list[str]:
        """Off, on, and the controls."""
        return ["off", "on", "shuffled", "semantic"]


@dataclass
class AgentTasksConfig:
    """``tasks`` is a folder of tasks in Terminal-Bench's layout; ``names`` chooses some of them."""

    tasks: str = ""
    names: list[str] = field(default_factory=list)


@dataclass
class AgentsBench(MemoryArms):
    """Every task of ``agents.tasks`` in the order of each seed, with each memory of ``arms``: ``agent`` works,
    ``verifier`` judges.
    """

    suite: str = "agents"
    agents: AgentTasksConfig = field(default_factory=AgentTasksConfig)
    agent: ComponentConfig = field(default_factory=ComponentConfig)


SUITES: Mapping[str, type[BenchConfig]] = MappingProxyType(
    {
        "reconstruction": ReconstructionBench,
        "robot": RobotBench,
        "agents": AgentsBench,
    }
)
"""The suites by name, with their options. The suites themselves are in :mod:`gvla2.evaluation.suites`."""
