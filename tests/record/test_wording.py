from collections.abc import Callable
from dataclasses import replace

import pytest
from markupsafe import Markup

from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.memory.contracts import Verdict
from gvla2.planning.trajectory import Orientation
from gvla2.record.page import templates
from gvla2.record.text import one_line, printable
from gvla2.record.wording import STAGES, finding, headline, number, ranked_candidates, state


def said(macro: str, *given: object) -> str:
    """What a macro of the page's words says of something."""
    words = templates().get_template("words.html.jinja").module
    return Markup(getattr(words, macro)(*given)).unescape().strip()


def test_each_stage_of_a_full_run_is_done_and_says_something(episode: Callable[..., EpisodeRecord]) -> None:
    record = episode()
    for stage in STAGES:
        assert state(record, stage) == "done"
        assert finding(record, stage)


def test_what_was_not_reached_is_skipped(failed_at: Callable[[str], EpisodeRecord]) -> None:
    record = failed_at("recall")
    states = {stage: state(record, stage) for stage in STAGES}
    assert states["reconstruct"] == "done"
    assert states["recall"] == "failed"
    assert {states[s] for s in ("plan", "check", "execute", "verify", "learn", "success_check")} == {
        "skipped"
    }


def test_a_motion_that_stopped_is_named(episode: Callable[..., EpisodeRecord]) -> None:
    record = episode()
    assert record.report is not None
    stopped = replace(record.report.waypoints[2], abort="slipped")
    short = replace(record, report=replace(record.report, waypoints=(*record.report.waypoints[:2], stopped)))
    assert finding(short, "execute") == "2 of 6 waypoints, stopped at waypoint 2 (lift): slipped"
    assert state(short, "execute") == "failed"


def test_a_verifier_that_says_no_is_not_a_broken_run(episode: Callable[..., EpisodeRecord]) -> None:
    record = episode(
        success_check=None,
        verdict=Verdict.from_criteria({"moved": 0.0}, ("It did not move.",)),
        failure=Failure("verify", "not_achieved", "It did not move."),
    )
    assert headline(record) == ("Verifier: failure", "bad")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.1 + 0.2, "0.3"),
        (2.0, "2"),
        (4e-5, "4e-05"),
        (0.0, "0"),
        (float("nan"), "–"),
        (None, "–"),
        (100.0, "100"),
    ],
)
def test_numbers_read_well(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("orientation", "words"),
    [
        (Orientation("hold"), "as before"),
        (Orientation("grasp", (0, 0, -1), (0, -1, 0)), "points down, fingers along y"),
        (Orientation("axis", (1, 0, 0)), "points +x"),
        (Orientation("twist", (0, 0, 1), angle=1.5708), "turned 90° about up"),
        (Orientation("slerp", (0, 1, 1), angle=0.5), "50 % of the way to (0, 0.71, 0.71)"),
    ],
)
def test_orientations_in_words(orientation: Orientation, words: str) -> None:
    assert said("orientation", orientation) == words


def test_the_best_candidate_that_was_not_rejected_is_the_chosen_one(
    episode: Callable[..., EpisodeRecord],
) -> None:
    plan = episode().plan
    assert plan is not None
    ranked = ranked_candidates(plan)
    assert [chosen for _, _, chosen in ranked] == [True, False, False]
    assert ranked[0][0].score == 0.91
    assert ranked[-1][0].rejected


def test_escapes_and_changes_of_direction_go() -> None:
    assert printable("a\x1b[0m\u202eb\nc") == "a [0m b\nc"


def test_one_line_is_cut_at_its_width() -> None:
    assert one_line("a\n\n b" * 100, 10) == "a ba ba b…"
