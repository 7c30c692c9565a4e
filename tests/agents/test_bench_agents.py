"""`gvla2 bench agents` whole: memories beside one another, resuming, and what cannot be measured."""

from pathlib import Path

import pytest

from gvla2.commands.bench import run_bench
from gvla2.errors import ConfigurationError
from gvla2.evaluation.results import Results
from tests.agents.scripted import giving
from tests.composing import bench_config
from tests.local_model import LocalModel, refused

OURS = Path(__file__).parents[2] / "examples" / "agent_tasks"
STEPS = {"photos": ["bash bin/deposit photos --commit"], "letters": ["bash bin/deposit letters --commit"]}


@pytest.fixture
def compose_agents(registry, tmp_path: Path):
    def chosen(url: str, *more: str):
        overrides = (
            "suite=agents", f"agents.tasks={OURS}", "agents.names=[deposit-photos,deposit-letters]",
            "seeds=[0]", "arms=[off,governed]", "verifier=exit_status", "quiet=true", f"language.base_url={url}",
            "language.model=m", "language.cache=",
            f"results.url=sqlite:///{tmp_path}/r.sqlite", *more,
        )  # fmt: skip
        return bench_config(registry, *overrides)

    return chosen


def rows(tmp_path: Path) -> dict[tuple[str, str], dict]:
    with Results.open(f"sqlite:///{tmp_path}/r.sqlite") as results:
        return {(c.factors["memory"], c.factors["task"]): c.flat() for c in results.cells("agents")}


def test_memories_meet_the_same_tasks_and_the_table_tells_their_cost(
    sandboxed, compose_agents, registry, tmp_path: Path
):
    with LocalModel(giving(STEPS)) as model:
        run_bench(compose_agents(model.url), registry, tmp_path / "out")
        asked = len(model.requests)
        found = rows(tmp_path)
        assert {key: row["solved"] for key, row in found.items()} == dict.fromkeys(found, 100.0)
        assert len(found) == 4
        assert {row["steps"] for row in found.values()} == {2.0}
        second = max((k for k in found if k[0] == "governed"), key=lambda k: found[k]["place"])
        assert found[second]["recalled"] >= 1
        assert found[second]["storage_kb"] > 0
        run_bench(compose_agents(model.url), registry, tmp_path / "again")
        assert len(model.requests) == asked, "what is measured is not asked again"
    page = (tmp_path / "out" / "report.md").read_text()
    assert "KnowledgeBank" in page
    assert "SR %" in page


def test_an_interrupted_sequence_is_measured_anew(sandboxed, compose_agents, registry, tmp_path: Path):
    answer, failing = giving(STEPS), []

    def lost_in_the_second(request):
        asked = request["messages"][1]["content"]
        first = failing[0] if failing else failing.append(asked.split("folder ")[1][:12]) or failing[0]
        return answer(request) if first in asked.split("Lessons from earlier")[0] else refused(401, "gone")

    with LocalModel(lost_in_the_second) as model:
        run_bench(compose_agents(model.url, "arms=[governed]"), registry, tmp_path / "out")
        assert [row["status"] == "ok" for row in rows(tmp_path).values()].count(True) == 1
        failing[0] = "folder"
        before = len(model.requests)
        run_bench(compose_agents(model.url, "arms=[governed]"), registry, tmp_path / "out2")
        again = model.requests[before:]
    found = rows(tmp_path)
    assert len(found) == 2
    assert len(again) == 4
    prompts = [request["messages"][1]["content"] for request in again]
    assert ["--commit" in prompt for prompt in prompts] == [False, False, True, True]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("agents.tasks=", "is not set"),
        ("agents.names=[nothing]", "Available"),
        ("arms=[mystery]", "No arm 'mystery'"),
    ],
)
def test_what_is_asked_wrongly_is_said(compose_agents, registry, tmp_path: Path, override, message):
    with pytest.raises(ConfigurationError, match=message):
        run_bench(compose_agents("http://127.0.0.1:9/v1", override), registry, tmp_path / "out")
