"""Options of tasks and cameras that the command line's schema shows: nothing heavy is imported here."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError

KINDS = ("none", "gaussian", "l515", "realistic")
_SHARES = ("dropout", "flying", "grazing", "dark")


@dataclass
class DepthNoise:
    """Errors of a cell's cameras; independent of each other, all off by default.

    Per pixel: the deviation at a depth of d metres is ``sigma_m`` + ``sigma_rel`` * d metres; ``dropout`` is the share
    of pixels in [0, 1] that measure nothing; ``flying`` the share of those at steps in depth that lie between both
    sides; ``grazing`` and ``dark`` the shares lost on surfaces at grazing angles and on dark ones; ``quantum_m`` the
    unit of depth, metres; ``colour`` the deviation of colours, in [0, 1].

    Per camera, constant over an episode: ``bias_rel`` the deviation over cameras of an error in scale of depth,
    ``exposure`` that of their gain, and the error of their believed pose, ``offset_m`` metres and ``turn_deg`` degrees.
    ``kind`` names this noise in reports. :mod:`gvla2.robot.depth_noise` has the sources. Raises
    :class:`ConfigurationError` for values out of range.
    """

    kind: str = "none"
    sigma_m: float = 0.0
    sigma_rel: float = 0.0
    dropout: float = 0.0
    flying: float = 0.0
    grazing: float = 0.0
    dark: float = 0.0
    bias_rel: float = 0.0
    quantum_m: float = 0.0
    colour: float = 0.0
    exposure: float = 0.0
    offset_m: float = 0.0
    turn_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigurationError(f"depth_noise.kind is '{self.kind}'; it is one of {', '.join(KINDS)}.")
        for name, value in vars(self).items():
            if name in _SHARES and not (0 <= value <= 1 and (name != "dropout" or value < 1)):
                bounds = "[0, 1)" if name == "dropout" else "[0, 1]"
                raise ConfigurationError(f"depth_noise.{name}={value} is a share of pixels in {bounds}.")
            if name not in ("kind", *_SHARES) and not 0 <= value < math.inf:
                raise ConfigurationError(f"depth_noise.{name}={value} must be finite and not negative.")


@dataclass
class TaskConfig(ComponentConfig):
    """Base of a task's configuration: a task whose options extend it can be cluttered (:mod:`gvla2.robot.clutter`).

    ``distractors`` things lie beside what the task needs. They are simple shapes, or meshes of the folder
    ``distractors_root``; ``arrangement`` is "apart", "touching" (in pairs), "leaning" (a board against a block),
    "stack" (threes, one on another) or "mixed".
    """

    distractors: int = 0
    distractors_root: str = ""
    arrangement: str = "apart"
