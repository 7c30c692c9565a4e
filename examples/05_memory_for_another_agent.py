"""The KnowledgeBank behind another agent: mini-swe-agent recalls before it works and learns when it has.

No language model and no network: mini-swe-agent's own deterministic model plays the agent.

    pip install "mini-swe-agent>=2.4,<3"
    python examples/05_memory_for_another_agent.py
"""

import os
import sys
import tempfile

from gvla2.memory import KnowledgeBank

os.environ.setdefault("MSWEA_SILENT_STARTUP", "1")
try:
    from minisweagent.agents.default import DefaultAgent
    from minisweagent.environments.local import LocalEnvironment
    from minisweagent.models.test_models import DeterministicModel, make_output
except ImportError:
    print('This example needs mini-swe-agent: pip install "mini-swe-agent>=2.4,<3"')
    sys.exit()

SYSTEM = "You work in a shell."
PROMPT = "Task: {{task}}\n\nWhat earlier tasks have taught, as data:\n{{memory}}"


class RememberingAgent(DefaultAgent):
    """An agent with a bank; ``check`` is the command whose exit status says whether the task is done."""

    def __init__(self, bank: KnowledgeBank, check: str, *args, **options):
        super().__init__(*args, system_template=SYSTEM, instance_template=PROMPT, cost_limit=0, **options)
        self.bank, self.check = bank, check

    def run(self, task: str = "", **kwargs) -> dict:
        recalled = self.bank.recall(task)
        result = super().run(task, memory=recalled.text or "nothing", **kwargs)
        done = self.env.execute({"command": self.check})
        commands = [a["command"] for m in self.messages for a in m.get("extra", {}).get("actions", [])]
        transcript = "\n".join([*(f"$ {command}" for command in commands), done["output"]])
        success = done["returncode"] == 0
        learned = self.bank.learn(task, transcript, success=success, recalled=recalled)
        print(f"{task}: {success=}, learned {', '.join(learned.added + learned.merged) or 'nothing'}")
        return result


def work(bank: KnowledgeBank, folder: str, task: str, check: str, *commands: str) -> str:
    """Let an agent that gives these commands do the task; what its prompt said."""
    last = "echo COMPLETE_TASK_AND_SUBMIT_FINAL_OUTPUT"
    script = [make_output("next", [{"command": command}]) for command in (*commands, last)]
    model, shell = DeterministicModel(outputs=script), LocalEnvironment(cwd=folder)
    agent = RememberingAgent(bank, check, model, shell)
    agent.run(task)
    return agent.messages[1]["content"]


with tempfile.TemporaryDirectory() as folder, KnowledgeBank(f"{folder}/memory.db") as bank:
    first, second = "sort the names in names.txt", "sort the lines of towns.txt"
    work(
        bank,
        folder,
        first,
        "sort -c names.txt",
        "printf 'b\\na\\n' > names.txt",
        "sort -o names.txt names.txt",
    )
    # The second agent does not listen, fails, and leaves a constraint for the third.
    prompt = work(bank, folder, second, "sort -c towns.txt", "printf 'y\\nx\\n' > towns.txt")
    print(f"\nThe second prompt:\n{prompt}")
