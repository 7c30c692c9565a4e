"""The released layouts: what a line means, and that it can be written back as it was."""

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.interop import items_layout, robot_layout, states_layout
from gvla2.memory.interop.lines import Line, LineError, parse, read_lines, to_text
from gvla2.memory.interop.memory_items import items_of, lesson_of, pieces
from gvla2.memory.interop.vocabulary import outcome_of, seconds_of

MARKDOWN = """```
# Memory Item 1
## Title Search before editing
## Description Find the callers first.
## Content Use the search of the repository before a change.

# Memory Item 2
## Title Run the tests
## Description
## Content Run them after each change.
```
"""


def line(file: str = "active.jsonl", **fields: object) -> Line:
    return Line(file, 7, fields)


STATE_RECORD: dict[str, object] = {
    "memory_id": "django-1-0-ab",
    "task_id": "django-1",
    "query": "fix the migration",
    "content": "Run the tests after each change.",
    "memory_type": "tool_usage",
    "source_status": "verified_success",
    "state": "active",
    "confidence": 0.62,
    "quality_score": 0.81,
    "created_at": "2026-05-01T10:00:00+00:00",
    "last_used_at": None,
    "use_count": 3,
    "dedup_key": "tool_usage:run tests",
    "supersedes": [],
    "conflicts_with": ["other"],
    "embedding": None,
    "verifier_score": 0.81,
    "verifier_confidence": 0.62,
    "verifier_label": "verified_success",
    "verifier_criteria": {"root cause": 0.9},
    "verifier_model": "judge",
}


def test_a_record_of_the_states_layout_is_understood():
    (entry,) = states_layout.read(Line("archive.jsonl", 1, STATE_RECORD))
    assert (entry.key, entry.task_id, entry.query) == ("django-1-0-ab", "django-1", "fix the migration")
    assert (entry.type, entry.outcome, entry.state) == ("tool_usage", "verified_success", "archive")
    assert (entry.confidence, entry.quality, entry.usage) == (0.62, 0.81, 3)
    assert entry.created == 1777629600.0
    assert entry.conflicts == ("other",)
    assert entry.verifier["criteria"] == {"root cause": 0.9}
    assert "in the file of the archive ones" in entry.notes[0]


@pytest.mark.parametrize(
    ("status", "outcome"),
    [
        ("success", "verified_success"),
        ("verified_success", "verified_success"),
        ("SUCCESS ", "verified_success"),
        (True, "verified_success"),
        ("fail", "verified_fail"),
        ("failure", "verified_fail"),
        ("verified_fail", "verified_fail"),
        (False, "verified_fail"),
        ("uncertain", "uncertain"),
        (None, "uncertain"),
        ("maybe", None),
    ],
)
def test_both_vocabularies_of_a_status(status: object, outcome: str | None):
    assert outcome_of(status) == outcome
    fields = {"memory_items": ["Open the drawer first."], "status": status}
    (entry,) = items_layout.read(line("bank.jsonl", **fields))
    assert entry.outcome == (outcome or "uncertain")
    assert bool(entry.notes) is (outcome is None)


def test_a_recipe_from_a_failure_becomes_something_to_avoid():
    fields = STATE_RECORD | {"memory_type": "procedural_hint", "verifier_label": "verified_fail"}
    (entry,) = states_layout.read(Line("active.jsonl", 1, fields))
    assert entry.type == "failure_avoidance"
    assert any("recipe" in note for note in entry.notes)
    assert states_layout.write([entry]) == fields


def test_the_reason_of_a_failed_attempt_is_part_of_the_lesson():
    fields = {
        "task_id": "t",
        "task_text": "抓起瓶盖",
        "outcome": "failure",
        "failure_reason": "夹爪滑脱",
        "memory_text": "优先抓上沿。",
        "tags": ["瓶盖"],
        "embedding": [0.5, 1.0],
    }
    (entry,) = robot_layout.read(line("robot_tasks.jsonl", **fields))
    assert entry.type == "failure_avoidance"
    assert entry.content == "优先抓上沿。\nFailed: 夹爪滑脱"
    assert robot_layout.write([entry]) == fields


def test_items_in_markdown_are_lessons_of_their_own():
    first, second = items_layout.read(
        line("m.jsonl", task_id=5, query="q", memory_items=MARKDOWN, status="success")
    )
    assert first.content == (
        "Search before editing\nFind the callers first.\nUse the search of the repository before a change."
    )
    assert second.content == "Run the tests\nRun them after each change."
    assert first.task_id == "5"


def test_items_may_be_objects_and_plain_text():
    listed = [{"title": "A", "description": "b", "content": "c", "more": 1}, "  plain words "]
    one, two = items_layout.read(line("m.jsonl", memory_items=listed, status="fail"))
    assert (one.content, two.content) == ("A\nb\nc", "plain words")
    assert items_layout.write([one, two])["memory_items"] == listed


def test_what_is_left_of_a_line_is_written_when_a_part_was_forgotten():
    first, second = items_layout.read(
        line(
            "m.jsonl", task_id="t", query="q", memory_items=MARKDOWN, status="success", think_list=["secret"]
        )
    )
    rest = items_layout.write([second])
    assert rest["task_id"] == "t"
    assert rest["status"] == "success"
    assert "secret" not in json.dumps(rest)
    assert "Search before editing" not in json.dumps(rest)
    assert "Run the tests" not in json.dumps(items_layout.write([first]))


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"content": "x"}, "'memory_id' is missing"),
        ({"memory_id": "a", "content": "  "}, "'content' is empty"),
        ({"memory_id": "a", "content": ["x"]}, "'content' is a list"),
        ({"memory_id": "a", "content": "x", "query": {}}, "'query' is an object"),
    ],
)
def test_what_is_no_record_says_why(fields: dict[str, object], why: str):
    with pytest.raises(LineError, match=why):
        states_layout.read(Line("active.jsonl", 1, fields))


def test_a_single_file_needs_a_state():
    with pytest.raises(LineError, match="'gone'"):
        states_layout.read(Line("bank.jsonl", 1, STATE_RECORD | {"state": "gone"}))
    assert states_layout.read(Line("bank.jsonl", 1, STATE_RECORD))[0].state == "active"


@pytest.mark.parametrize(
    ("value", "why"), [(3, "neither text nor a list"), (["a", 3], r"memory_items\[1\]"), (None, "neither")]
)
def test_items_that_are_none(value: object, why: str):
    with pytest.raises(LineError, match=why):
        items_of(value)


@pytest.mark.parametrize("value", ["", [], "```\n```", ["", "  "]])
def test_items_that_say_nothing(value: object):
    with pytest.raises(LineError, match="says nothing"):
        items_layout.read(line("m.jsonl", memory_items=value))


def test_every_kind_of_broken_line_is_named_and_the_others_read(tmp_path: Path):
    path = tmp_path / "bank.jsonl"
    good = json.dumps({"memory_items": "Lift slowly."})
    path.write_bytes(
        b"\xef\xbb\xbf"
        + good.encode()
        + b'\n\n{"a": NaN}\n[1]\n{"a":\n"text"\n\xff\xfe\n'
        + b"[" * 100_000
        + b"\n"
        + good.encode()
    )
    lines, remarks = read_lines(path)
    assert [found.number for found in lines] == [1, 9]
    assert [remark.line for remark in remarks] == [3, 4, 5, 6, 7, 8]
    told = " ".join(map(str, remarks))
    for why in ("NaN is no number", "a list, not an object", "no JSON", "text, not an object", "not UTF-8"):
        assert why in told
    assert "bank.jsonl, line 3" in told


def test_times():
    assert seconds_of("2026-05-01T10:00:00Z") == seconds_of("2026-05-01T10:00:00") == seconds_of(1777629600)
    assert [seconds_of(v) for v in ("soon", None, True, float("inf"), -5, [1])] == [None] * 6


# -- written back as it was -------------------------------------------------------------------------------------

json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(-1e6, 1e6) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
words = st.text(min_size=1, max_size=30).filter(lambda text: text.replace("\x00", "").strip())
extras = st.dictionaries(st.text(max_size=6).map("x_{}".format), json_values, max_size=3)
statuses = st.sampled_from(["success", "fail", "verified_success", "verified_fail", "uncertain", "odd", None])


@settings(max_examples=60, deadline=None)
@given(
    extras,
    st.fixed_dictionaries(
        {"memory_id": words, "content": words},
        optional={
            "query": st.text(max_size=9),
            "task_id": st.text(max_size=9) | st.integers(),
            "state": st.sampled_from(["active", "archive", "odd"]),
            "source_status": statuses,
            "memory_type": st.sampled_from(["procedural_hint", "tool_usage", "odd"]),
            "confidence": json_values,
            "quality_score": json_values,
            "use_count": json_values,
            "created_at": json_values,
            "last_used_at": json_values,
            "supersedes": json_values,
            "verifier_criteria": json_values,
            "embedding": st.lists(st.floats(-1, 1), max_size=3),
        },
    ),
)
def test_a_states_line_comes_back_as_it_was(extra: dict[str, object], fields: dict[str, object]):
    fields |= extra
    (entry,) = states_layout.read(Line("active.jsonl", 1, fields))
    written = states_layout.write([entry])
    assert list(written) == list(fields)
    assert parse(to_text(written)) == parse(to_text(fields))


@settings(max_examples=60, deadline=None)
@given(
    extras,
    st.text(max_size=40) | st.lists(st.text(max_size=20) | st.just(MARKDOWN), max_size=3) | st.just(MARKDOWN),
    statuses,
)
def test_an_items_line_comes_back_as_it_was(extra: dict[str, object], items: object, status: object):
    fields = {"task_id": "t", **extra, "memory_items": items, "status": status}
    try:
        entries = items_layout.read(Line("m.jsonl", 1, fields))
    except LineError:
        return
    written = items_layout.write(entries)
    assert list(written) == list(fields)
    assert written == fields


@settings(max_examples=60, deadline=None)
@given(extras, words, st.none() | st.text(max_size=9), statuses)
def test_a_robot_line_comes_back_as_it_was(extra: dict, text: str, reason: str | None, outcome: object):
    fields = {"task_text": "q", "outcome": outcome, "failure_reason": reason, "memory_text": text, **extra}
    (entry,) = robot_layout.read(Line("r.jsonl", 1, fields))
    assert robot_layout.write([entry]) == fields


@given(st.lists(st.text(max_size=12) | st.just("# Memory Item 3\n## Title x\n"), max_size=4).map("".join))
def test_pieces_join_to_the_text(text: str):
    found = pieces(text)
    assert "".join(found) == (text if found else "")
    assert all(lesson_of(piece) for piece in found)


def test_half_a_surrogate_pair_can_be_written():
    fields = {"memory_id": "a", "content": "x \ud83d y\x00"}
    assert parse(to_text(fields).encode()) == fields
