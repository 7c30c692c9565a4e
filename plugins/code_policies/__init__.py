"""The Code-as-Policies planner: a language model writes a program of skill calls, which is parsed, never executed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges
from gvla2.planning.calls import OPTION_RANGES

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2.planning.contracts import Planner


@dataclass(kw_only=True)
class CodePoliciesConfig(ComponentConfig):
    """Options of the ``code_policies`` planner, which asks the run's ``language``.

    ``tries`` bounds how often the model is asked, with the reasons when a program cannot be followed; ``samples``
    answers a try are drawn and the one that most agree on is taken. ``agreement`` in [0, 1]: where fewer of the
    samples than this share agree, it abstains. ``cautious`` declines wishes that rule something out ("not",
    "except") and programs that leave out what the wish names, as small models need; large ones do better without. A
    cautious planner lets a ``fallback`` that is sure go first.
    ``programs`` remembered successes at most are shown. ``lift_height`` and ``push_distance`` (metres) hold where
    the program gives no amount; ``speed`` of the tool in the open, ``contact_speed`` where it touches, m/s.
    ``explore`` > 0 varies each plan's numbers by this relative spread, another way for each ``explore_seed``.
    """

    tries: int = 3
    samples: int = 1
    agreement: float = 0.0
    cautious: bool = True
    programs: int = 2
    max_tokens: int = 200
    lift_height: float = 0.25
    push_distance: float = 0.10
    speed: float = 0.25
    contact_speed: float = 0.08
    explore: float = 0.0
    explore_seed: int = 0

    def __post_init__(self) -> None:
        check_ranges(self, "planner", OPTION_RANGES)


def _build(config: CodePoliciesConfig, language: LanguageModel) -> Planner:
    """Plans programs of skill calls by a language model."""
    from gvla2_plugins.code_policies.planner import CodePolicies

    return CodePolicies(config, language)


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """``planner=code_policies``."""
    return [Component("code_policies", CodePoliciesConfig, _build, needs=("language",))]
