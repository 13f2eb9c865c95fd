"""What all tests share: shapes checked at run time, and the folder of golden numbers."""

from __future__ import annotations

import os
import sys
from collections import Counter
from pathlib import Path

import jaxtyping
import pytest
from hypothesis import HealthCheck, settings

from tests.support import shape_checker

jaxtyping.jaxtyped = shape_checker.jaxtyped  # type: ignore[assignment]
jaxtyping.install_import_hook("latentmotion", f"{shape_checker.__name__}.checked")

# One thread, in processes that tests start too: the networks are too small to gain from more, and
# a sum is the same in every run only if as many threads share it.
os.environ["OMP_NUM_THREADS"] = "1"

# A test leaves nothing in the folders of who runs it, and no engine reports that it is imported.
os.environ["LATENTMOTION_CACHE"] = "off"
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

# To look up the shapes of an operation takes PyTorch longer than to compute them anew: graphs are
# traced in four fifths of the time, to the same bytes.
os.environ["TORCH_FAKE_TENSOR_DISPATCH_CACHE"] = "0"
sys.modules["openvino_telemetry"] = None  # type: ignore[assignment]

# Examples are the same each time, however long they take.
settings.register_profile(
    "repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("repeatable")

# Checks in other programs (Blender, three.js) have an environment of their own: tests/clients.
CLIENTS = {"LATENTMOTION_BPY", "LATENTMOTION_NODE_MODULES"}
collect_ignore = [] if CLIENTS & set(os.environ) else ["clients"]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Prints each reason for skipping once; a reason says what is missing and what adds it."""
    skipped = terminalreporter.stats.get("skipped", [])
    reasons = Counter(report.longrepr[2].removeprefix("Skipped: ") for report in skipped)
    for reason, count in reasons.most_common():
        terminalreporter.write_line(f"skipped {count}: {reason}")
    if collect_ignore:
        terminalreporter.write_line(
            f"left out tests/clients: pip install bpy, npm install what its conftest.py names, and "
            f"set {' and '.join(sorted(CLIENTS))}"
        )


# Imported after the hook above, so that what they import is checked too.
pytest_plugins = ["tests.support.fixtures"]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of golden numbers and real data; the test is skipped where there is none."""
    default = Path(__file__).parents[1].parent / "shared"
    folder = Path(os.environ.get("LATENTMOTION_SHARED", default))
    if not (folder / "reference").is_dir():
        pytest.skip(
            f"needs golden numbers and recordings: set LATENTMOTION_SHARED (looked in {folder})"
        )
    return folder
