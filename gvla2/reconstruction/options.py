"""The options of the GeoFuse-MV3D branch: the Hydra group ``branch`` of `gvla2 run`, `reconstruct` and `bench`.

Part of the command line's schema, so it imports nothing heavy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from gvla2.errors import ConfigurationError

MODES = ("default", "paper")
SOFT_HULL = ("tau", "eta", "lambda_max")
"""The soft visual hull's constants."""
REFERENCE = "baseline"
VARIANTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        REFERENCE: (),
        "a_prior_appearance": ("prior", "appearance"),
        "a_soft_hull": ("prior", "appearance", "soft_hull"),
        "b_axis": ("axis",),
        "ab_fusion": ("prior", "appearance", "soft_hull", "axis", "fusion"),
    }
)
"""The paper's rows by name, with the stages that each has; without any the branch's output is G0."""


@dataclass
class BranchOptions:
    """Which stages run, and how; each switch is one column of the ablation.

    The soft hull and the fusion are there for the paper's sake and off by default: with a verified prior they added
    nothing (docs/reconstruction.md).

    ``mode``: ``paper`` puts source B beside A, both from G0, without gates; ``default`` corrects drift first, continues
    from A, keeps a stage only where the masks do not contradict it, and finally moves the Gaussians as far inside their
    surface as the masks require (a part of ``appearance``). ``tau``, ``eta``, ``lambda_max``: the soft visual hull's
    lambda(p) = lambda_max * sigmoid((tau - s) / eta)^2 (released constants). Raises :class:`ConfigurationError` for
    values out of range.
    """

    prior: bool = True
    appearance: bool = True
    soft_hull: bool = False
    axis: bool = True
    fusion: bool = False
    mode: str = "default"
    tau: float = 0.45
    eta: float = 0.12
    lambda_max: float = 0.008

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ConfigurationError(f"branch.mode is '{self.mode}'; it is one of {', '.join(MODES)}.")
        if not (0 <= self.tau <= 1 and self.eta > 0 and 0 <= self.lambda_max < 1):
            raise ConfigurationError(
                f"The soft hull needs tau in [0, 1], eta > 0 and lambda_max in [0, 1), got branch.tau={self.tau:g}, "
                f"branch.eta={self.eta:g}, branch.lambda_max={self.lambda_max:g}."
            )

    @property
    def axis_alone(self) -> bool:
        """Whether source B is the output where nothing is fused: nothing else moves the geometry."""
        return self.axis and not (self.prior or self.soft_hull)

    def row(self, variant: str) -> BranchOptions:
        """These options without the stages that a row of the ablation lacks, and with its soft hull and fusion."""
        has = VARIANTS[variant]
        stages: dict[str, Any] = {
            name: name in has and getattr(self, name) for name in ("prior", "appearance", "axis")
        }
        return replace(self, soft_hull="soft_hull" in has, fusion="fusion" in has, **stages)

    def changed(self) -> dict[str, str]:
        """The options that differ from the defaults, as the command line writes them."""
        usual = vars(BranchOptions())
        return {name: str(value).lower() for name, value in vars(self).items() if usual[name] != value}

    def label(self) -> str:
        """The options that differ from the defaults, for a table; "default" if none does."""
        return ", ".join(f"{name}={value}" for name, value in self.changed().items()) or "default"
