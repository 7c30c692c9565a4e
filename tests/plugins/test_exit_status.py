"""The exit status as a verdict: 0, everything else, and what says nothing."""

from typing import Any

import pytest

from gvla2.memory.contracts import Evidence, Verdict
from gvla2_plugins.exit_status import ExitStatusConfig, gvla2_verifiers


def judge(facts: dict[str, Any], **options: Any) -> Verdict:
    (component,) = gvla2_verifiers()
    return component.build(ExitStatusConfig(name="exit_status", **options)).verify(
        Evidence("list the files", "ls", facts)
    )


@pytest.mark.parametrize("status", [0, "0", " 0\n", 0.0, -0, "ok", "PASSED"])
def test_success(status: object):
    verdict = judge({"exit_status": status})
    assert (verdict.outcome, verdict.quality, verdict.confidence) == ("verified_success", 1.0, 1.0)
    assert verdict.criteria == {"exit_status": 1.0}


@pytest.mark.parametrize(
    ("status", "word"),
    [(1, "status 1."), ("2", "status 2."), (-9, "SIGKILL"), (137, "SIGKILL"), (139, "SIGSEGV"), (-250, "signal 250"),
     (255, "255"), ("timeout", "timeout"), ("LimitsExceeded", "LimitsExceeded"), (2.0, "status 2.")],
)  # fmt: skip
def test_failure(status: object, word: str):
    verdict = judge({"exit_status": status})
    assert (verdict.outcome, verdict.quality) == ("verified_fail", 0.0)
    assert word in verdict.reasons[0]


@pytest.mark.parametrize(
    "facts",
    [{"timed_out": True}, {"timed_out": "yes", "exit_status": 0}, {"signal": 11}, {"signal": "SIGTERM"},
     {"exit_status": 0, "signal": 15}, {"exit_status": None, "timed_out": 1}],
)  # fmt: skip
def test_time_outs_and_signals_fail_whatever_the_status_says(facts: dict[str, Any]):
    assert judge(facts).outcome == "verified_fail"


@pytest.mark.parametrize(
    "facts", [{"timed_out": False}, {"timed_out": "false"}, {"signal": None}, {"signal": 0}]
)
def test_what_did_not_happen_does_not_count(facts: dict[str, Any]):
    assert judge({"exit_status": 0, **facts}).outcome == "verified_success"


@pytest.mark.parametrize(
    "facts",
    [{}, {"exit_status": None}, {"exit_status": True}, {"exit_status": False}, {"exit_status": ""},
     {"exit_status": "Submitted"}, {"exit_status": 0.5}, {"exit_status": float("nan")}, {"exit_status": [0]},
     {"exit_status": "9" * 5000}, {"exit_status": "٠"}, {"status": 0}],
    ids=lambda f: str(f)[:30],
)  # fmt: skip
def test_what_tells_nothing_is_unavailable_with_a_reason(facts: dict[str, Any]):
    verdict = judge(facts)
    assert verdict.outcome == "unavailable"
    assert verdict.reasons[0]
    assert len(verdict.reasons[0]) < 300


def test_words_and_the_fact_are_options():
    assert judge({"exit_status": "Submitted"}, success=["submitted"]).outcome == "verified_success"
    assert judge({"exit_status": "GaveUp"}, failure=["gaveup"]).outcome == "verified_fail"
    assert judge({"code": 1, "exit_status": 0}, fact="code").outcome == "verified_fail"
