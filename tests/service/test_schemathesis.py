"""Requests made from the OpenAPI document, right and wrong: no answer is the service's fault.

`LATENTMOTION_SCHEMATHESIS=10000` makes that many, a few by default.
"""

from __future__ import annotations

import os
from collections import Counter
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings

from tests.service.conftest import Called

schemathesis = pytest.importorskip("schemathesis")
requests = pytest.importorskip("requests")

CASES = int(os.environ.get("LATENTMOTION_SCHEMATHESIS", "60"))
MAY_FAIL = (429, 503)  # The service is busy.


@pytest.mark.filterwarnings("ignore")  # words that no model knows, and motions far from any floor
def test_no_request_is_the_services_fault(called: Called) -> None:
    check_requests(called)


def check_requests(called: Called, prefix: str = "", cases: int = CASES) -> None:
    """Sends so many requests to all paths of a prefix."""
    schema = schemathesis.openapi.from_dict(called.get("/openapi.json").json())
    operations = [found.ok() for found in schema.get_all_operations()]
    operations = [one for one in operations if one.path.startswith(prefix)]
    modes = schemathesis.GenerationMode
    # Nothing can be wrong where nothing is sent.
    alone = [one for one in operations if not next(iter(one.iter_parameters()), one.body)]
    kinds = [(one, modes.POSITIVE, 1) for one in alone]
    others = [one for one in operations if one not in alone]
    share = -(-cases // (2 * len(others)))
    kinds += [(one, mode, share) for one in others for mode in (modes.POSITIVE, modes.NEGATIVE)]
    statuses: Counter[tuple[str, int]] = Counter()
    for operation, mode, count in kinds:
        check = settings(
            max_examples=count,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
            database=None,
        )(given(operation.as_strategy(generation_mode=mode))(_called(called, statuses)))
        check()
    print(sum(statuses.values()), "cases", sorted(statuses.items()))
    assert sum(statuses.values()) >= cases
    assert {200, 422} <= {status for _, status in statuses}


def _called(called: Called, statuses: Counter[tuple[str, int]]) -> Any:
    def one(case: Any) -> None:
        sent = requests.Request(**case.as_transport_kwargs("http://localhost")).prepare()
        answer = called.wait(
            called.client.request(sent.method, sent.url, headers=sent.headers, content=sent.body)
        )
        statuses[case.operation.label, answer.status_code] += 1
        assert answer.status_code < 500 or answer.status_code in MAY_FAIL, (sent.url, sent.body)
        if answer.status_code >= 400:
            assert answer.headers["content-type"] == "application/problem+json"
            assert answer.json()["detail"]
            assert "Traceback" not in answer.text
            assert "/tmp/" not in answer.text.replace(str(sent.body), "")

    return one
