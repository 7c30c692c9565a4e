"""The schema of `gvla2 reconstruct`: what can be asked on the command line, with types and defaults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError

MODES = ("default", "paper")
COMPATS = ("none", "official")
NO_TARGETS = "none"


@dataclass
class BranchConfig:
    """Which stages of the branch run and how: :class:`gvla2.reconstruction.branch.BranchOptions` as Hydra options."""

    prior: bool = True
    appearance: bool = True
    soft_hull: bool = True
    axis: bool = True
    fusion: bool = True
    mode: str = "default"
    compat: str = "none"
    tau: float = 0.45
    eta: float = 0.12
    lambda_max: float = 0.008

    def __post_init__(self) -> None:
        for name, value, known in (("mode", self.mode, MODES), ("compat", self.compat, COMPATS)):
            if value not in known:
                raise ConfigurationError(f"branch.{name} is '{value}'; it is one of {', '.join(known)}.")
        if not (0 <= self.tau <= 1 and self.eta > 0 and 0 <= self.lambda_max < 1):
            raise ConfigurationError(
                f"The soft hull needs tau in [0, 1], eta > 0 and lambda_max in [0, 1), got branch.tau={self.tau:g}, "
                f"branch.eta={self.eta:g}, branch.lambda_max={self.lambda_max:g}."
            )


@dataclass
class ReconstructConfig:
    """One object from calibrated views.

    ``views`` is their folder, ``views_spec`` which of them are the input (``0-4``, or ``[0-4,7]`` where a comma is
    needed; by default the protocol's 0-4 of a GSO-30 tree and all of another folder), ``size`` their longer side in
    pixels. ``targets`` are views held out to judge by (by default the protocol's 10-24 of a GSO-30 tree; ``none``
    leaves them out), ``truth`` is a mesh file in the views' frame. ``object`` is the name to show, the folder's by
    default; ``measure`` judges by held-out views and true mesh even if ``targets`` and ``truth`` are not given;
    ``frames`` the turntable's pictures; ``quiet`` leaves only errors on the terminal.
    """

    views: str | None = None
    views_spec: Any = None
    size: int | None = None
    targets: Any = None
    truth: str | None = None
    object: str | None = None
    measure: bool = False
    frames: int = 12
    quiet: bool = False
    reconstructor: ComponentConfig = field(default_factory=ComponentConfig)
    prior: ComponentConfig = field(default_factory=ComponentConfig)
    axis: ComponentConfig = field(default_factory=ComponentConfig)
    fusion: ComponentConfig = field(default_factory=ComponentConfig)
    renderer: ComponentConfig = field(default_factory=ComponentConfig)
    branch: BranchConfig = field(default_factory=BranchConfig)

    def __post_init__(self) -> None:
        self.views_spec = spec_of("views_spec", self.views_spec)
        self.targets = spec_of("targets", self.targets)
        if self.size is not None and self.size < 8:
            raise ConfigurationError(f"size is {self.size}; views need at least 8 pixels.")
        if not 2 <= self.frames <= 120:
            raise ConfigurationError(f"frames is {self.frames}; a turntable has 2 to 120.")


def spec_of(option: str, value: Any) -> str | None:
    """A view spec as text, from what the command line makes of ``0-4``, ``7``, ``[0-4,7]`` or ``null``."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, str | int | Sequence):
        raise ConfigurationError(f"{option} is {value!r}; write views such as 0-4 or [0-4,7].")
    if isinstance(value, str | int):
        return str(value)
    return ",".join(str(item) for item in value)
