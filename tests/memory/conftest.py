"""Banks as they open by default, a clock that tests set, and episodes."""

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from gvla2.memory.bank import BankOptions, KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryContext, MemoryEpisode, MemoryTask, Verdict


class Clock:
    """Seconds since the epoch, as the test says."""

    def __init__(self) -> None:
        self.now = 1.8e9

    def __call__(self) -> float:
        return self.now

    def pass_days(self, days: float) -> None:
        self.now += days * 86400


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'memory.db'}"


@pytest.fixture
def open_bank(url: str, clock: Clock) -> Iterator[Callable[..., KnowledgeBank]]:
    opened = []

    def open_(
        bank: str = "default", busy_seconds: float = 0.2, verifier: Any = None, **options: object
    ) -> KnowledgeBank:
        opened.append(
            KnowledgeBank(
                url,
                bank=bank,
                verifier=verifier,
                options=BankOptions(**options),  # type: ignore[arg-type]
                busy_seconds=busy_seconds,
                clock=clock,
            )
        )
        return opened[-1]

    yield open_
    for bank in opened:
        bank.close()


SUCCESS = Verdict.from_criteria({"task_completion": 1.0, "collision_safety": 0.9}, ["done"], "test")
FAIL = Verdict.from_criteria({"task_completion": 0.0, "collision_safety": 0.4}, ["missed"], "test")
UNCERTAIN = Verdict.from_criteria({"task_completion": 0.5}, ["unclear"], "test")
UNAVAILABLE = Verdict.unavailable("no network", "test")


@pytest.fixture
def verdicts() -> dict[str, Verdict]:
    return {"success": SUCCESS, "fail": FAIL, "uncertain": UNCERTAIN, "unavailable": UNAVAILABLE}


@pytest.fixture
def episode() -> Callable[..., MemoryEpisode]:
    runs = count(1)

    def make(
        query: str = "Pick up the red cube",
        *lessons: Lesson,
        skill: str = "pick",
        recalled: MemoryContext | None = None,
        source: str | None = None,
    ) -> MemoryEpisode:
        return MemoryEpisode(
            MemoryTask(query, skill),
            lessons or (hint(),),
            recalled=recalled or MemoryContext(),
            source=source or f"run/{next(runs)}",
            provenance={"planner": "skill"},
        )

    return make


def hint(
    content: str = "Pick up (grasp, grab, take, lift, raise) a small box: this grasp depth succeeded.",
) -> Lesson:
    effect = {"kind": "prior", "parameter": "grasp_depth", "value": 0.02, "op": ">=", "sd": 0.0, "count": 1,
              "skill": "pick", "source": ""}  # fmt: skip
    return Lesson("procedural_hint", content, effect)
