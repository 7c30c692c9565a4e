"""A verifier that is wrong in a share of its verdicts, and as sure as ever."""

from dataclasses import replace
from types import SimpleNamespace

from gvla2.memory.contracts import Evidence, Verdict
from gvla2_plugins.flaky import FlakyConfig, FlakyVerifier

GOOD = Verdict.from_criteria({"task_completion": 0.9}, ("It is done.",), "inner")


def judge(
    verdict: Verdict, episode: int = 0, rate: float = 0.2, seed: int = 0, withheld: float = 0.0
) -> Verdict:
    inner = SimpleNamespace(verify=lambda evidence: verdict)
    config = FlakyConfig(name="flaky", rate=rate, seed=seed, withheld=withheld)
    return FlakyVerifier(inner, config).verify(Evidence("open it", f"episode {episode}"))


def test_a_fifth_of_the_sure_verdicts_is_the_opposite_and_the_same_again():
    said = [judge(GOOD, episode) for episode in range(1000)]
    wrong = [verdict for verdict in said if verdict.outcome == "verified_fail"]
    assert 150 < len(wrong) < 250
    assert said == [judge(GOOD, episode) for episode in range(1000)]
    assert said != [judge(GOOD, episode, seed=1) for episode in range(1000)]
    assert {(round(one.quality, 6), one.confidence, one.reasons) for one in wrong} == {
        (0.1, GOOD.confidence, ())
    }
    assert judge(judge(GOOD, rate=1.0), rate=1.0).outcome == "verified_success"
    for open_one in (Verdict.unavailable("no camera"), replace(GOOD, outcome="uncertain")):
        assert judge(open_one, rate=1.0) == open_one


def test_half_of_the_sure_verdicts_is_withheld_beside_the_wrong_ones():
    said = [judge(GOOD, episode, withheld=0.5).outcome for episode in range(1000)]
    assert 450 < said.count("unavailable") < 550
    assert 150 < said.count("verified_fail") < 250
