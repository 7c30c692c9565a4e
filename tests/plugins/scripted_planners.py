"""What the tests of planners that ask a language model share: a planner at a scripted server, and the checks."""

from typing import Any

from gvla2.language import AskingOptions, Endpoint, EndpointOptions
from gvla2.planning.checks import check_trajectory
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.testing import inputs
from tests.local_model import LocalModel, said

REQUEST = inputs.plan_request()


class ScriptedPlanner:
    """The one planner of a plugin: ``at`` a server that a test has, or ``planned`` by a server with one answer."""

    def __init__(self, planners: Any, config: type) -> None:
        (self.component,), self._config = planners(), config

    def at(self, model: LocalModel, **options: Any) -> Any:
        language = Endpoint(
            AskingOptions(timeout=10.0, retries=0), EndpointOptions(base_url=model.url, model="m")
        )
        return self.component.build(self._config(**options), language=language)

    def planned(self, answer: str, request: PlanRequest = REQUEST, **options: Any) -> Plan:
        with LocalModel(lambda _: said(answer)) as model:
            plan: Plan = self.at(model, **options).plan(request)
            return plan


def passes(plan: Plan, request: PlanRequest = REQUEST) -> None:
    assert plan.trajectory is not None, plan.abstention
    report = check_trajectory(plan.trajectory, request.scene, request.arm, request.start, request.joints)
    assert report.passed, report.reasons
