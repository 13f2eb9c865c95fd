"""Provenance of files: the command that runs, the commit of this code, the processor."""

from __future__ import annotations

import platform
import shlex
import subprocess
import sys
from pathlib import Path


def command_line() -> str:
    """Returns the command that runs, as a shell would take it."""
    program = "latentmotion" if Path(sys.argv[0]).name == "__main__.py" else Path(sys.argv[0]).name
    return shlex.join([program, *sys.argv[1:]])


def commit() -> str:
    """Returns the commit of this code; empty where it is not in a repository."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def processor() -> str:
    """Returns the name of the processor, as the system has it."""
    return _cpu_info("model name") or platform.processor() or platform.machine()


def processor_flags() -> set[str]:
    """Returns what the processor can do, as Linux names it; elsewhere nothing is known."""
    return set((_cpu_info("flags") or _cpu_info("Features")).split())


def _cpu_info(name: str) -> str:
    """Returns what Linux says of the first processor under a name; empty if nothing."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    values = (line.split(":", 1)[1].strip() for line in lines if line.startswith(name))
    return next(values, "")
