"""The Code-as-Policies planner: a language model writes a program of skill calls, which is parsed, never executed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges
from gvla2.planning.calls import OPTION_RANGES, SkillOptions

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2.planning.contracts import Planner


@dataclass(kw_only=True)
class CodePoliciesConfig(SkillOptions, ComponentConfig):
    """Options of the ``code_policies`` planner, which asks the run's ``language``.

    The model is asked at most ``tries`` times, each time with the reason why its last program cannot be executed;
    ``programs`` is the maximum number of remembered successes in the prompt, ``calls`` the maximum number of calls in a
    program. All others are as in :class:`~gvla2.planning.calls.SkillOptions`.
    """

    tries: int = 3
    programs: int = 2
    calls: int = 6
    max_tokens: int = 200

    def __post_init__(self) -> None:
        check_ranges(self, "planner", {**OPTION_RANGES, "calls": (1, 12, "")})


def _build(config: CodePoliciesConfig, language: LanguageModel) -> Planner:
    """Plans programs of skill calls by a language model."""
    from gvla2_plugins.code_policies.planner import CodePolicies

    return CodePolicies(config, language)


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """``planner=code_policies``."""
    return [Component("code_policies", CodePoliciesConfig, _build, needs=("language",))]
