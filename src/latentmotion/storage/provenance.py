"""Provenance of files: command, commit and processor; terms, as the Hugging Face Hub names them.

Source: https://huggingface.co/docs/hub/model-cards and https://huggingface.co/docs/hub/datasets-cards.
"""

from __future__ import annotations

import json
import platform
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any


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


# The hub's task that is nearest to motion from text; it has none of its own.
PIPELINE = "text-to-3d"

# Spellings of licenses, and the hub's identifiers.
_LICENSES = {
    r"cc[ -]?by[ -]?sa[ -]?([34])\.0": "cc-by-sa-{}.0",
    r"cc[ -]?by[ -]?nc[ -]?([34])\.0": "cc-by-nc-{}.0",
    r"cc[ -]?by[ -]?([34])\.0": "cc-by-{}.0",
    r"cc0([ -]1\.0)?": "cc0-1.0",
    r"apache[ -]?(license )?2\.0": "apache-2.0",
    r"mit": "mit",
}


def front_matter(fields: Mapping[str, Any]) -> str:
    """Returns fields as the YAML block that opens a page; empty ones are left out.

    JSON is YAML, so each value is a line of JSON.
    """
    lines = (f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in fields.items())
    filled = (line for line, value in zip(lines, fields.values(), strict=True) if value)
    return "\n".join(["---", *filled, "---", ""])


def license_fields(terms: Iterable[str]) -> dict[str, str]:
    """Returns the hub's fields for terms; what has no identifier there is `other`, by its name."""
    texts, identifiers = sorted(set(terms)), set[str]()
    for text in texts:
        plain = re.sub(r"\s+(unported|international|generic|license)$", "", text.strip().lower())
        for pattern, identifier in _LICENSES.items():
            if match := re.fullmatch(pattern, plain):
                identifiers.add(identifier.format(*match.groups()))
    if len(texts) == len(identifiers) == 1:
        return {"license": identifiers.pop()}
    return {"license": "other", "license_name": "; ".join(texts) or "unknown"}
