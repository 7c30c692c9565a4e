"""The exit status as a verdict: 0, any other number, and statuses that say nothing."""

from typing import Any

import pytest

from gvla2.memory.contracts import Evidence, Verdict
from gvla2_plugins.exit_status import ExitStatusConfig, gvla2_verifiers


def judge(facts: dict[str, Any], **options: Any) -> Verdict:
    (component,) = gvla2_verifiers()
    evidence = Evidence("list the files", "ls", facts)
    return component.build(ExitStatusConfig(name="exit_status", **options)).verify(evidence)


@pytest.mark.parametrize("status", [0, "0", " 0\n"])
def test_zero_is_a_success(status: object):
    verdict = judge({"exit_status": status})
    assert (verdict.outcome, verdict.quality, verdict.confidence) == ("verified_success", 1.0, 1.0)
    assert verdict.criteria == {"exit_status": 1.0}


@pytest.mark.parametrize(
    "facts", [{"exit_status": 1}, {"exit_status": "-9"}, {"exit_status": 0, "timed_out": True}]
)
def test_another_number_and_a_time_out_are_failures(facts: dict[str, Any]):
    assert (judge(facts).outcome, judge(facts).quality) == ("verified_fail", 0.0)


@pytest.mark.parametrize("status", [None, True, "", "Submitted", 0.5, float("nan"), [0], "9" * 5000, "٠"])
def test_a_status_that_says_nothing_is_unavailable_with_a_reason(status: object):
    verdict = judge({"exit_status": status})
    assert verdict.outcome == "unavailable"
    assert 0 < len(verdict.reasons[0]) < 300
