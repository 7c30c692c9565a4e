"""One task from recall to lesson: the real mini-swe-agent, a real sandbox, a model that follows a script."""

from pathlib import Path

import pytest

from gvla2.agents.sandbox import bubblewrap
from gvla2.agents.tasks import attempt, read_tasks
from gvla2.errors import ConfigurationError
from gvla2.language.contracts import LanguageModelError
from gvla2.memory import KnowledgeBank
from gvla2.testing import check_agent
from gvla2_plugins.exit_status import ExitStatusConfig, ExitStatusVerifier
from gvla2_plugins.mini_swe import MiniSwe, MiniSweConfig
from tests.agents.scripted import block, endpoint, giving
from tests.local_model import LocalModel, refused, said

OURS = Path(__file__).parents[2] / "examples" / "agent_tasks"
RIGHT = {"photos": ["ls", "bash bin/deposit photos --commit"], "letters": ["bash bin/deposit letters"]}


def tried(name: str, url: str, bank: KnowledgeBank, **options):
    (task,) = read_tasks(OURS, [name])
    agent = MiniSwe(MiniSweConfig(name="mini_swe", **options), endpoint(url))
    with bubblewrap(task) as box:
        return attempt(
            task, agent, box, bank, ExitStatusVerifier(ExitStatusConfig(name="exit_status")),
            source=name, show_tests=True,
        )  # fmt: skip


def test_a_success_teaches_what_another_task_of_its_family_is_told(sandboxed, tmp_path: Path):
    with LocalModel(giving(RIGHT)) as model, KnowledgeBank(tmp_path / "m.db") as bank:
        first = tried("deposit-photos", model.url, bank)
        assert first.solved
        assert first.run.steps == 3
        assert first.verdict.outcome == "verified_success"
        assert first.run.usage["calls"] == 3
        second = tried("deposit-letters", model.url, bank)
    assert not second.solved
    assert "--commit" in second.recalled.text
    prompts = [request["messages"][1]["content"] for request in model.requests]
    assert "--commit" not in prompts[0]
    assert "--commit" in prompts[-1]
    assert "data, not orders" in prompts[-1]


@pytest.mark.parametrize("prompts", ["", str(OURS / "short.yaml")])
def test_a_failure_teaches_what_the_program_refused_not_what_came_after(
    sandboxed, tmp_path: Path, prompts: str
):
    with (
        LocalModel(giving({"march": ["bash bin/seal march", "ls"]})) as model,
        KnowledgeBank(tmp_path / "m.db") as bank,
    ):
        assert not tried("seal-march", model.url, bank, prompts=prompts).solved
        (lesson,) = bank.records()
    assert lesson.type == "failure_avoidance"
    assert lesson.content.endswith("failed; bash bin/seal march printed: seal: the ledger march is locked")


@pytest.mark.parametrize(
    ("answer", "ended", "steps"),
    [
        (giving({}), "Submitted", 1),
        (lambda request: said(block("ls")), "LimitsExceeded", 4),
        (lambda request: said("I cannot help with that."), "RepeatedFormatError", 0),
    ],
)
def test_an_agent_that_submits_too_early_never_or_refuses_fails(
    sandboxed, tmp_path: Path, answer, ended: str, steps: int
):
    with LocalModel(answer) as model, KnowledgeBank(tmp_path / "m.db") as bank:
        made = tried("deposit-photos", model.url, bank, steps=4)
    assert (made.run.exit_status, made.run.steps, made.solved) == (ended, steps, False)
    assert made.verdict.outcome == "verified_fail"


def test_prompts_may_be_those_of_another_configuration_file(sandboxed, tmp_path: Path):
    with LocalModel(giving(RIGHT)) as model, KnowledgeBank(tmp_path / "m.db") as bank:
        assert tried("deposit-photos", model.url, bank, prompts=str(OURS / "short.yaml")).solved
    first, last = model.requests[0]["messages"], model.requests[-1]["messages"]
    assert first[0]["content"].startswith("You solve a task with bash commands")
    assert first[1]["content"].startswith("Put the folder /app/photos")
    assert last[-1]["content"].startswith("It printed:\ndeposit: stored")
    (tmp_path / "prompts.yaml").write_text("agent: 3")
    with pytest.raises(ConfigurationError, match=r"agent\.prompts.*prompts\.yaml"):
        MiniSwe(MiniSweConfig(name="mini_swe", prompts=str(tmp_path / "prompts.yaml")), endpoint(model.url))


def test_a_model_that_is_not_there_is_nobodys_failure(sandboxed, tmp_path: Path):
    with (
        LocalModel(lambda request: refused(401, "no")) as model,
        KnowledgeBank(tmp_path / "m.db") as bank,
        pytest.raises(LanguageModelError),
    ):
        tried("deposit-photos", model.url, bank)


def test_it_keeps_the_contract_of_an_agent():
    with LocalModel(giving({})) as model:
        check_agent(MiniSwe(MiniSweConfig(name="mini_swe"), endpoint(model.url)))
