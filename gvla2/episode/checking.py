"""The checks before motion on an episode's plan, with one round of repair."""

from __future__ import annotations

from dataclasses import replace

from gvla2.episode.advice import advice_for
from gvla2.episode.failure_diagnosis import theme_of
from gvla2.episode.lessons import handled_lengths
from gvla2.episode.record import EpisodeRecord
from gvla2.planning.arm import Arm
from gvla2.planning.checks import check_trajectory
from gvla2.planning.findings import CheckReport
from gvla2.planning.looks import look_of, own_first
from gvla2.planning.repair import repair
from gvla2.planning.trajectory import Trajectory


def check_plan(record: EpisodeRecord, arm: Arm) -> tuple[EpisodeRecord, CheckReport]:
    """The report on the record's plan, and the record with the plan repaired if that made it pass."""
    assert record.plan is not None
    assert record.plan.trajectory is not None
    assert record.scene is not None
    assert record.observation is not None
    scene, start, joints = record.scene, record.observation.world_from_tcp, record.observation.joints
    effects = own_first(advice_for(record).effects, look_of(theme_of(record), scene))
    parameters, skill, lengths = record.plan.parameters, record.plan.skill, handled_lengths(record)

    def check(trajectory: Trajectory) -> CheckReport:
        return check_trajectory(
            trajectory, scene, arm, start, joints, effects, parameters, skill=skill, lengths=lengths
        )

    report = check(record.plan.trajectory)
    if report.passed:
        return record, report
    repaired, repairs = repair(record.plan.trajectory, report, scene, arm)
    if not repairs:
        return record, report
    second = replace(check(repaired), repairs=repairs)
    if not second.passed:
        return record, report
    return replace(record, plan=replace(record.plan, trajectory=repaired)), second
