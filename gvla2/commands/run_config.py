"""The schema of `gvla2 run`: what can be asked on the command line, with types and defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gvla2.errors import ConfigurationError
from gvla2.evaluation.config import ResultsConfig
from gvla2.plugins.hydra_config import EveryKind
from gvla2.reconstruction.options import BranchOptions
from gvla2.robot.options import DepthNoise


@dataclass
class RunConfig(EveryKind):
    """One episode, or many. Besides these options there is one group for each kind of component.

    ``instruction`` replaces the task's own sentence; ``seed`` lays out the first episode, the next ones count up;
    ``quiet`` prints only the result. After an attempt that the verifier is sure has failed, the robot looks and plans
    again up to ``replan`` times an episode, told what went wrong. A planner that gives no answer within
    ``planner_timeout`` seconds ends its episode; 0 waits for ever. Where the planner fails or declines for lack of
    means, ``fallback`` plans, another planner or none. A program that takes several plans is carried out in up to
    ``max_parts``. ``branch`` holds the options of the reconstruction branch, which runs where a ``reconstructor`` is
    chosen. A sweep puts its jobs into the database ``results``; jobs that are done in its folder are kept, unless
    ``results.fresh``.
    """

    instruction: str | None = None
    seed: int = 0
    episodes: int = 1
    quiet: bool = False
    replan: int = 0
    planner_timeout: float = 60.0
    max_parts: int = 6
    depth_noise: DepthNoise = field(default_factory=DepthNoise)
    branch: BranchOptions = field(default_factory=BranchOptions)
    results: ResultsConfig = field(default_factory=ResultsConfig)

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigurationError(f"episodes is {self.episodes}; it must be at least 1.")
        if self.seed < 0:
            raise ConfigurationError(f"seed is {self.seed}; it must not be negative.")
        if self.replan < 0:
            raise ConfigurationError(f"replan is {self.replan}; it must not be negative.")
        if self.max_parts < 1:
            raise ConfigurationError(f"max_parts is {self.max_parts}; it must be at least 1.")
        if not 0 <= self.planner_timeout < math.inf:
            raise ConfigurationError(
                f"planner_timeout is {self.planner_timeout}; it is in seconds, finite and not negative (0: for ever)."
            )
