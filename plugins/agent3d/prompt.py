"""The model's prompt: the waypoint format, one example, remembered paths, the scene."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

from gvla2.language import Message
from gvla2.planning.contracts import PlanRequest
from gvla2.planning.programs import remembered
from gvla2.planning.scene_brief import SceneBrief
from gvla2.programs.remembered import Remembered
from gvla2.programs.waypoints import written
from gvla2.skills.asked_paths import instruction_in

EXAMPLE_THINGS = {
    False: "tan_sponge 60x50x40\nwhite_bowl 140x140x60 open 130",
    True: "tan_sponge 60x50x40 at 100,50\nwhite_bowl 140x140x60 open 130 at 300,-100",
}
EXAMPLE_TASK = "drop the sponge into the bowl"
EXAMPLE_PATH = {
    False: '[["tan_sponge",0,0,100,1],["tan_sponge",0,0,-20,1],["tan_sponge",0,0,-20,0],'
    '["tan_sponge",0,0,120,0],["white_bowl",0,0,100,0],["white_bowl",0,0,20,1]]',
    True: "[[100,50,120,1],[100,50,20,1],[100,50,20,0],[100,50,190,0],[300,-100,180,0],[300,-100,80,1]]",
}


def messages(
    request: PlanRequest, brief: SceneBrief, known: Sequence[Remembered], *, bare: bool
) -> list[Message]:
    """The question, after answered examples: one of the format, then remembered paths, with the present names and
    sizes. Memory's text is between marks, as data: the checks apply regardless.
    """
    about = [name for path in known for name in path.names]
    things = _by_relevance(brief, request.instruction, about)
    turns = [(_question(EXAMPLE_THINGS[bare], EXAMPLE_TASK), EXAMPLE_PATH[bare])]
    for path in known:
        turns.append((_question(things, path.task), written(path.steps)))
    form = files(__package__).joinpath("bare.md" if bare else "relative.md").read_text("utf-8").strip()
    asked: list[Message] = [{"role": "system", "content": form}]
    for question, answer in turns:
        asked += [{"role": "user", "content": question}, {"role": "assistant", "content": answer}]
    question = _question(things, instruction_in(request))
    words = filter(None, (remembered(request.advice.text.strip()), question))
    asked.append({"role": "user", "content": "\n".join(words)})
    return asked


def _question(things: str, task: str) -> str:
    return f"Things (name, length x width x height in mm):\n{things}\nTask: {task}"


def _by_relevance(brief: SceneBrief, instruction: str, about: Sequence[str]) -> str:
    """The lines of the brief, first those of things in remembered paths or the task: small models start with what they
    read first.
    """
    said = instruction.casefold()

    def rank(line: str) -> tuple[int, int]:
        name = line.partition(" ")[0]
        found = [said.find(word) for word in name.split("_") if len(word) > 2 and word in said]
        return (0 if name in about else 1, -len(found))

    return "\n".join(sorted(brief.text.splitlines(), key=rank))


def _one_line(text: str) -> str:
    return " ".join(text.split())[:400]


def rejected_path(reasons: Sequence[str], path: str) -> list[Message]:
    """The checks' findings on a path, as a message to the model."""
    said = " ".join(_one_line(r) for r in reasons)[:1200]
    asked: list[Message] = [{"role": "assistant", "content": path}] if path else []
    why = f"That path cannot be carried out. {said}\nWrite a better path."
    return [*asked, {"role": "user", "content": why}]
