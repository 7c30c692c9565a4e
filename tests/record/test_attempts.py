import pytest

from gvla2.episode.record import Failure
from gvla2.memory.contracts import Verdict
from gvla2.record.page import render_page
from gvla2.record.pictures import Pictures
from gvla2.record.recorder import STAGE_FILES

FAILED = Verdict.from_criteria({"theme_at_goal": 0.0}, ("The cube is elsewhere.",), "geometric")


@pytest.fixture
def twice(episode):
    """An episode whose first attempt failed."""
    failure = Failure("verify", "not_achieved", "The cube is <b>elsewhere</b>.")
    first = episode(
        verdict=FAILED,
        failure=failure,
        success_check=None,
        learned=None,
        timings={"plan": 2.0, "execute": 3.0},
    )
    return episode(attempts=(first,), timings={"plan": 1.0, "execute": 2.5})


def test_every_attempt_is_in_the_result(twice, episode):
    told = twice.result("run")
    assert [a["verdict"] for a in told["attempts"]] == ["verified_fail", "verified_success"]
    assert [a["timings"]["plan"] for a in told["attempts"]] == [2.0, 1.0]
    assert told["attempts"][0]["failure"]["kind"] == "not_achieved"
    assert told["failure"] is None
    assert twice.seconds == 8.5
    assert len(episode().result("run")["attempts"]) == 1


def test_the_earlier_attempts_have_a_file_with_plan_and_report(twice, episode):
    content = STAGE_FILES["attempts.json"]
    (first,) = content(twice)
    assert first["report"]["completed"] == twice.attempts[0].report.completed
    assert len(first["trajectory"]["waypoints"]) == first["plan"]["waypoints"]
    assert first["verdict"]["outcome"] == "verified_fail"
    assert content(episode()) is None


def test_the_page_tells_of_attempts_only_where_there_were_several(twice, episode):
    page = render_page(twice, Pictures())
    table = page[page.index('id="attempts"') : page.index('id="seen"')]
    assert '<span class="tag bad">failure</span>' in table
    assert '<span class="tag good">success</span>' in table
    assert "not_achieved: The cube" in table
    assert "&lt;b&gt;elsewhere" in page
    assert "8.5 s" in page
    assert 'id="attempts"' not in render_page(episode(), Pictures())
