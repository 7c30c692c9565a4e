"""What a model's answer is taken for when it consolidates."""

import pytest

from gvla2.errors import Gvla2Error
from gvla2.language import EndpointOptions
from gvla2.memory.records import Record
from gvla2.testing.language import LocalModel, said
from gvla2_plugins.governed.writer import LanguageWriter, read_edit


def test_an_edit_may_stand_in_a_fence_or_after_other_words():
    answer = (
        'I think {so}.\n```json\n{"action": "MERGE", "target": "a", "content": "5 cm", "reason": null}\n```'
    )
    edit = read_edit(answer, ["a", "b"])
    assert (edit.action, edit.target, edit.content, edit.reason) == ("MERGE", "a", "5 cm", "")
    assert read_edit('{"action": "ADD"}', []).target == ""


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("no idea", "not an edit"),
        ('{"action": "FORGET", "target": "a"}', "not an edit"),
        ('{"action": "MERGE", "target": "z", "content": "x"}', "was not shown"),
        ('{"action": "DISCARD"}', "was not shown"),
    ],
)
def test_anything_else_is_an_error(answer: str, said: str):
    with pytest.raises(Gvla2Error, match=said):
        read_edit(answer, ["a"])


def lesson(id: str, content: str) -> Record:
    return Record(
        id,
        "b",
        "lift\nraise",
        content,
        "procedural_hint",
        "active",
        "verified_success",
        1.0,
        1.0,
        id,
        0.0,
        0.0,
    )


def test_a_lesson_is_put_to_a_real_server_and_its_edit_read():
    def reply(request):
        told = request["messages"][-1]["content"]
        assert "<new>\nn | task: lift | Lift it 5 cm.\n</new>" in told
        return said('{"action": "DISCARD", "target": "m", "reason": "the same"}')

    with LocalModel(reply) as model:
        writer = LanguageWriter(EndpointOptions(base_url=model.url, model="any"))
        edit = writer.consolidate(lesson("n", "Lift it 5 cm."), [lesson("m", "Lift it by 5 cm.")])
    assert (edit.action, edit.target) == ("DISCARD", "m")
