from gvla2 import hookimpl
from gvla2.planning.skill import Parameter, Role, Skill


def propose(job):
    from gvla2.planning.skill import Proposal
    from gvla2.skills.proposals import Path, horizontal, pointing

    (x, y, _), theta = job.theme.centre, job.theta
    touch = job.theme.top + job.hand.tip_beyond_tcp
    for yaw in (0.0, 0.8, 1.6, 2.4):  # several ways: the one easiest for the arm is taken
        hand = pointing(horizontal(yaw))
        path = Path(theta["speed"], theta["contact_speed"], hand, gripper=0.0)
        path.go("approach", [x, y, touch + theta["standoff"]])
        path.line("tap", [x, y, touch], allowed=job.own, slow=True)
        path.line("retreat", [x, y, touch + theta["standoff"]], allowed=job.own)
        yield Proposal(f"tap at {yaw} rad", ("approach:top",), 0.8, path.trajectory())


@hookimpl
def gvla2_skills():
    numbers = [("standoff", "m", 0.2), ("speed", "m/s", 0.5), ("contact_speed", "m/s", 0.25)]
    return [Skill(
        "tap", "touch a thing on its top with closed fingers",
        roles=[Role("theme", "what is touched")],
        parameters=[Parameter(name, unit, name, 0.0, most) for name, unit, most in numbers],
        propose=lambda job: list(propose(job)),
        defaults=lambda theme, hand, options: {
            "standoff": 0.05, "speed": options.speed, "contact_speed": options.contact_speed},
        words="Tap (touch)", key=["standoff"],
    )]  # fmt: skip
