"""The released layouts: what a line means."""

import json
from pathlib import Path

import pytest

from gvla2.memory.interop.layouts import count, lesson_of, number, read_items, read_robot, read_states, share
from gvla2.memory.interop.lines import Line, LineError, parse, read_lines, to_bytes

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
    (entry,) = read_states(Line("archive.jsonl", 1, STATE_RECORD))
    assert (entry.key, entry.task_id, entry.query) == ("django-1-0-ab", "django-1", "fix the migration")
    assert (entry.type, entry.outcome, entry.state) == ("tool_usage", "verified_success", "archive")
    assert (entry.confidence, entry.quality, entry.usage) == (0.62, 0.81, 3)
    assert entry.created == 1777629600.0
    assert entry.conflicts == ("other",)
    assert entry.verifier["criteria"] == {"root cause": 0.9}


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
    fields = {"memory_items": ["Open the drawer first."], "status": status}
    (entry,) = read_items(line("bank.jsonl", **fields))
    assert entry.outcome == (outcome or "uncertain")
    assert bool(entry.notes) is (outcome is None)


def test_a_recipe_from_a_failure_becomes_something_to_avoid():
    fields = STATE_RECORD | {"memory_type": "procedural_hint", "verifier_label": "verified_fail"}
    (entry,) = read_states(Line("active.jsonl", 1, fields))
    assert entry.type == "failure_avoidance"


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
    (entry,) = read_robot(line("robot_tasks.jsonl", **fields))
    assert entry.type == "failure_avoidance"
    assert entry.content == "优先抓上沿。\nFailed: 夹爪滑脱"


def test_items_in_markdown_are_lessons_of_their_own():
    first, second = read_items(line("m.jsonl", task_id=5, query="q", memory_items=MARKDOWN, status="success"))
    assert first.content == (
        "Search before editing\nFind the callers first.\nUse the search of the repository before a change."
    )
    assert second.content == "Run the tests\nRun them after each change."
    assert first.task_id == "5"


def test_items_may_be_objects_and_plain_text():
    listed = [{"title": "A", "description": "b", "content": "c", "more": 1}, "  plain words "]
    one, two = read_items(line("m.jsonl", memory_items=listed, status="fail"))
    assert (one.content, two.content) == ("A\nb\nc", "plain words")


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"content": "x"}, "'memory_id' is missing"),
        ({"memory_id": "a", "content": "  "}, "'content' is missing or empty"),
        ({"memory_id": "a", "content": ["x"]}, "'content' is no text"),
        ({"memory_id": "a", "content": "x", "query": {}}, "'query' is no text"),
    ],
)
def test_what_is_no_record_says_why(fields: dict[str, object], why: str):
    with pytest.raises(LineError, match=why):
        read_states(Line("active.jsonl", 1, fields))


def test_a_single_file_needs_a_state():
    with pytest.raises(LineError, match="'gone'"):
        read_states(Line("bank.jsonl", 1, STATE_RECORD | {"state": "gone"}))
    assert read_states(Line("bank.jsonl", 1, STATE_RECORD))[0].state == "active"


@pytest.mark.parametrize(
    ("value", "why"), [(3, "neither text"), (["a", 3], "neither text"), (None, "neither")]
)
def test_items_that_are_none(value: object, why: str):
    with pytest.raises(LineError, match=why):
        read_items(line("m.jsonl", memory_items=value))


@pytest.mark.parametrize("value", ["", [], "```\n```", ["", "  "]])
def test_items_that_say_nothing(value: object):
    with pytest.raises(LineError, match="says nothing"):
        read_items(line("m.jsonl", memory_items=value))


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
    for why in ("NaN is no JSON number", "not a JSON object", "it is no JSON object", "not UTF-8"):
        assert why in told
    assert "bank.jsonl, line 3" in told


@pytest.mark.parametrize(
    ("value", "seconds"),
    [("2026-05-01T10:00:00Z", 1777629600.0), ("2026-05-01T10:00:00", 1777629600.0), (1777629600, 1777629600.0),
     ("soon", None), (True, None), (-5, None), ([1], None), (1e300, None)],
)  # fmt: skip
def test_times(value: object, seconds: float | None):
    (entry,) = read_states(line(**(STATE_RECORD | {"created_at": value})))
    assert entry.created == seconds


@pytest.mark.parametrize(
    "value", [10**400, -(10**400), float("inf"), float("nan"), 1e300, True, None, "7", []]
)
def test_numbers_beyond_all_bounds(value: object):
    assert share(value) in (None, 1.0)
    assert 0 <= count(value) <= 2**53
    assert number(value) in (None, 1e300)


def test_a_piece_without_headings_is_the_lesson_as_it_stands():
    assert lesson_of("```\n1. open\n2. close\n```") == "1. open\n2. close"
    assert lesson_of("# Memory Item 1\n## Title\n") == ""


def test_lines_that_readers_would_cut_or_databases_refuse():
    text = to_bytes([{"content": "a\u2028b\x85c"}]).decode()
    assert text.splitlines() == [text.rstrip("\n")]
    assert parse(text.encode()) == {"content": "a\u2028b\x85c"}
