"""Arms, rows and options of `gvla2 bench` as they are asked for."""

from dataclasses import replace

import pytest

from gvla2.commands.bench import as_overrides
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.arms import chosen_arms
from gvla2.evaluation.suites.robot_design import designs, subjects, world_of
from gvla2.reconstruction.options import VARIANTS
from tests.composing import bench_config


def config_of(registry, *arguments: str):
    return bench_config(registry, *as_overrides(["robot", "conditions=clean", *arguments]))


def test_an_arm_of_ones_own_needs_no_plus_and_stands_beside_those_that_are_listed(registry):
    config = config_of(registry, "arms=[off,on]", "arms.mine={memory: governed, admission: false, replan: 1}")
    off, on, mine = chosen_arms(config, registry)
    assert (off.source, on.memory, on.variant) == ("off", "governed", "")
    assert (mine.memory, mine.replan, mine.options) == ("governed", 1, {"admission": False})
    assert mine.variant == "governed, admission=False, replan=1"
    usual = config_of(registry, "arms.mine={memory: semantic}")
    assert usual.chosen_arms == ["off", "on", "shuffled", "semantic", "mine"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["arms.mine={memory: gouverned}"], "No arm 'gouverned'.*governed"),
        (["arms.mine={memory: governed, admision: false}"], "admision.*Did you mean 'admission'"),
        (["arms.mine={memory: off, admission: false}"], "'off' has no such option"),
        (["arms.mine=3"], "give options"),
        (["arms.mine={memory: off, replan: yes}"], "a count"),
        (["arms.mine={memory: off, geometry: hull}"], "one of none, baseline, a_prior_appearance"),
        (["arms.off.geometry=ab_fusion", "arms=[off]"], "need a reconstructor"),
    ],
)
def test_errors_of_arms_list_the_available_ones(registry, arguments, message):
    with pytest.raises(ConfigurationError, match=message):
        designs(config_of(registry, *arguments), registry)


def test_rows_of_refined_geometry_are_arms_beside_perceived_boxes(registry):
    config = bench_config(registry, "experiment=geofuse_robot", "layouts=[0]", "tasks=[pick_and_lift]")
    (design,) = designs(config, registry)
    shown = {one.arm.name: one.factors["geometry"] for one in design.plan}
    assert shown == {"off": "none"} | {name: name for name in VARIANTS}
    assert len({key for one in design.plan for key in one.keys}) == 2 * len(design.plan)
    assert not any(one.factors.get("variant") for one in design.plan)
    stages = [name for name, on in vars(config.branch.row("a_soft_hull")).items() if on is True]
    assert stages == ["prior", "appearance", "soft_hull"]


def test_two_variants_of_one_memory_share_no_cell(registry):
    config = config_of(
        registry, "tasks=[lamp_on]", "layouts=[200]", "exploration_seeds=[1]", "arms=[off,on]",
        "arms.a={memory: governed, failures: false}", "arms.b={memory: governed, governance: false}",
        "arms.c={memory: off, replan: 1}",
    )  # fmt: skip
    (design,) = designs(config, registry)
    keys = [key for one in design.plan for key in one.keys]
    assert len(set(keys)) == len(keys) == 2 * 5
    variants = {one.arm.name: one.factors.get("variant", "") for one in design.plan}
    assert variants == {
        "off": "", "on": "", "a": "governed, failures=False", "b": "governed, governance=False", "c": "off, replan=1",
    }  # fmt: skip
    again = designs(replace(config, own_arms={**config.own_arms, "a": {"memory": "governed"}}), registry)
    changed = {
        one.arm.name for one, old in zip(again[0].plan, design.plan, strict=True) if one.keys != old.keys
    }
    assert changed == {"a"}, "an arm's options are in its own key alone"


def test_task_options_are_in_the_rows_name_and_key(registry):
    plain = config_of(registry, "tasks=[open_jar]", "arms=[off]", "layouts=[200]")
    stiff = config_of(
        registry, "tasks=[open_jar]", "arms=[off]", "layouts=[200]", "task_options.open_jar.turn=175"
    )
    assert subjects(stiff, registry) == {"open_jar (turn=175)": {"name": "open_jar", "turn": 175}}
    one, other = designs(plain, registry)[0].plan[0], designs(stiff, registry)[0].plan[0]
    assert other.subject == "open_jar (turn=175)"
    assert set(one.keys).isdisjoint(other.keys)
    for wrong, message in (
        ("task_options.open_jar.trun=3", "Did you mean 'turn'"),
        ("task_options.lamp_on.travel=3", "not among the tasks"),
    ):  # fmt: skip
        with pytest.raises(ConfigurationError, match=message):
            subjects(config_of(registry, "tasks=[open_jar]", wrong), registry)


def test_a_learnable_world_has_a_row_a_family_and_a_design_a_world(registry):
    config = config_of(registry, "world=learnable", "seeds=[1,2]", "episodes=1", "arms=[off,on]")
    rows = subjects(config, registry)
    assert "open_drawer, family 1" in rows
    assert len(rows) == 10
    made = designs(config, registry)
    assert [world_of(design.config) for design in made] == ["learnable-1", "learnable-2"]
    assert {one.factors["world"] for design in made for one in design.plan} == {"learnable"}
    keys = [key for design in made for one in (*design.plan, *design.exploring) for key in one.keys]
    assert len(keys) == len(set(keys)), "each world is explored anew"


def test_an_option_of_another_suite_is_refused_with_those_that_there_are(capsys):
    from gvla2.commands.bench import main

    assert main(["reconstruction", "arms=[off]", "--cfg", "job"]) == 1
    assert "Key 'arms' not in 'ReconstructionBench'" in capsys.readouterr().err
    assert main(["robt"]) == 1
    assert "Did you mean 'robot'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("override", "factor", "shown"),
    [
        ("robot.finger_friction=0.01", "robot", "sapien_panda (finger_friction=0.01)"),
        ("verifier.margin=0.02", "verifier", "geometric (margin=0.02)"),
        (
            "reconstructor=hull",
            "components",
            "reconstructor hull, axis contours, fusion residual, renderer numba",
        ),
        ("exploration_seeds=[5,6]", "learning", "exploration_seeds=[5, 6]"),
        ("retriever.top_k=1", "learning", "retriever hybrid (top_k=1)"),
    ],
)
def test_a_rows_factors_name_every_unusual_option(registry, override: str, factor: str, shown: str):
    def shown_of(*given: str) -> tuple[str, str]:
        (design,) = designs(config_of(registry, "tasks=[lamp_on]", "arms=[on]", *given), registry)
        return str(design.plan[0].factors.get(factor, "")), design.plan[0].keys[1]

    usual, changed = shown_of(), shown_of(override)
    assert changed[0] == shown != usual[0]
    assert changed[1] != usual[1]


def test_a_named_layout_is_the_episode_of_the_seed_that_lays_it_out(registry):
    def places(*given: str) -> dict[str, tuple[object, object]]:
        (design,) = designs(config_of(registry, "tasks=[lamp_on]", "arms=[off]", *given), registry)
        return {one.keys[1]: (one.factors["seed"], one.factors["episode"]) for one in design.plan}

    named = places("layouts=[20001,203]")
    assert list(named.values()) == [(1, 1), ("layouts", 203)]
    assert len(named.keys() & places("seeds=[1]", "episodes=2").keys()) == 1


def test_another_planner_can_explore(registry):
    given = ["tasks=[lamp_on]", "arms=[off,on]", "layouts=[200]", "exploration_seeds=[0]", "planner=agent3d"]
    (own,) = designs(config_of(registry, *given), registry)
    (taught,) = designs(config_of(registry, *given, "exploration_planner=skill"), registry)
    for design, explorer in ((own, "agent3d"), (taught, "skill")):
        assert design.exploring[0].config.planner.name == explorer
        assert str(design.exploring[0].factors["planner"]).startswith(explorer)
        assert {one.config.planner.name for one in design.plan} == {"agent3d"}
    assert [one.keys for one in own.plan if one.arm.name == "off"] == [
        one.keys for one in taught.plan if one.arm.name == "off"
    ]
    assert "exploration_planner=skill" in str(taught.plan[1].factors["learning"])
    with pytest.raises(Gvla2Error, match="skil"):
        designs(config_of(registry, *given, "exploration_planner=skil"), registry)


def test_other_tasks_than_the_tested_ones_can_be_explored(registry):
    given = ["tasks=[lamp_on]", "arms=[off,on]", "layouts=[200]", "exploration_seeds=[0,1]"]

    def taught(*also: str) -> tuple[list[tuple[str, object]], str, object]:
        (design,) = designs(config_of(registry, *given, *also), registry)
        (tested,) = [one for one in design.plan if one.arm.name == "on"]
        return (
            [(one.subject, one.layout) for one in design.exploring],
            tested.keys[0],
            tested.factors["learning"],
        )

    named = "exploration_tasks=[open_jar,put_block]"
    own, others = taught(), taught(named)
    assert taught(named, "task_options.lamp_on.scale=1.1")[0] == others[0]
    assert own[0] == [("lamp_on", 0), ("lamp_on", 1)]
    assert others[0] == [(task, seed) for task in ("put_block", "open_jar") for seed in (0, 1)]
    assert own[1] != others[1]
    assert "open_jar" in str(others[2])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["arms=[off,on]", "exploration_seeds=[]"], "exploration_seeds is empty"),
        (["arms=[off,on]", "exploration_seeds=[20000]"], "higher ones lay out the test"),
        (["arms=[on]", "layouts=[1]", "exploration_seeds=[0,1]"], "explored layout cannot be a test"),
        (["arms=[off,shuffled]"], "name two tasks or more"),
        (
            ["arms=[shuffled]", "tasks=[lamp_on,put_block]", "exploration_tasks=[open_jar]"],
            "no exploration_tasks",
        ),
        (["arms=[on]", "world=learnable", "exploration_tasks=[open_jar]"], "leave exploration_tasks out"),
        (["arms=[off]", "tasks=[lamp_of]"], "lamp_on"),
    ],
)
def test_designs_that_make_no_sense_are_refused(registry, given: list[str], message: str):
    with pytest.raises(ConfigurationError, match=message):
        designs(config_of(registry, "tasks=[lamp_on]", *given), registry)
