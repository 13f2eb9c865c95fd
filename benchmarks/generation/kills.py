"""Commands that are killed at random moments: is anything lost, half-written or different?

    python -m benchmarks.generation.kills --kills 50
    python -m benchmarks.generation.kills --kills 50 --only bulk files

Each kill is a SIGKILL within the time of a whole run, whose processes are forked from this one.

* bulk: shards of motions; the same command is started again until it ends.
* files: five formats of a motion, over older ones.
* data: a prepared folder, over an older one.
* library: takes of the studio, each told as kept.
* jobs: jobs of a service, which is started again until they are done; a tenth of the kills.

Trainings: `benchmarks.training.kills`.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from benchmarks.harness.contest import table
from benchmarks.harness.replicas import free_port
from latentmotion import formats
from latentmotion.cli.main import main as run
from latentmotion.motion import Motion
from latentmotion.studio.library import Edits, Library

FORMATS = (".bvh", ".glb", ".npz", ".csv", ".html")
TAKES = 12  # Takes that a process keeps before it ends.

JOB = {"prompts": ["a person walks", "a person jumps"], "count": 20, "seconds": 2}
PATIENCE = 120.0  # Seconds after which a job that is not done counts as lost.


@dataclass
class Count:
    """What kills did to a kind of work."""

    kills: int = 0
    results: int = 0  # Results that were looked at: runs, files, takes, jobs.
    problems: list[str] = field(default_factory=list)  # What was lost, half-written or different.


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints what was lost, half-written or different."""
    works = {"bulk": bulk, "files": files, "data": data, "library": library, "jobs": jobs}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50, help="of each kind of work")
    parser.add_argument("--only", nargs="*", default=list(works), choices=list(works))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    load, counts = os.getloadavg()[0], {name: Count() for name in options.only}
    with tempfile.TemporaryDirectory(dir=".") as folder:  # where files are synced
        os.chdir(folder)
        for name, count in counts.items():
            place = Path(name)
            place.mkdir()
            kills = max(1, options.kills // 10) if name == "jobs" else options.kills
            works[name](place.resolve(), kills, random.Random(f"{name} {options.seed}"), count)
        os.chdir("..")
    rows = [
        [name, str(one.kills), str(one.results), str(len(one.problems))]
        for name, one in counts.items()
    ]
    print(f"{os.cpu_count()} cores, load {load:.1f} before, {os.getloadavg()[0]:.1f} at the end")
    print(table(["killed", "times", "results checked", "lost, half-written, different"], rows))
    problems = [f"{name}: {one}" for name, count in counts.items() for one in count.problems]
    if problems:
        raise SystemExit("\n".join(problems))


def killed(work: Callable[[], None], seconds: float, log: Path) -> bool:
    """Runs work in a forked process and kills it after a time; returns whether it was killed.

    Raises:
        SystemExit: It failed by itself.
    """
    child = os.fork()
    if child == 0:
        code = 1
        try:
            with log.open("w", encoding="utf-8") as file:
                os.dup2(file.fileno(), 1)
                os.dup2(file.fileno(), 2)
            work()
            code = 0
        except SystemExit as end:
            code = 3 if end.code else 0
        finally:
            os._exit(code)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        number, status = os.waitpid(child, os.WNOHANG)
        if number:
            break
        time.sleep(0.001)
    else:
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code not in (0, -signal.SIGKILL):
        raise SystemExit(f"work ended with {code}: {log.read_text(encoding='utf-8')[-2000:]}")
    return code != 0


def generated(path: Path, seed: int) -> Motion:
    """Generates a motion in a process of its own, since one with sessions cannot be forked."""
    words = ["generate", "a person walks", "--seconds", "2", "--seed", str(seed), "-o", str(path)]
    killed(lambda: run(words), 1e9, path.with_suffix(".log"))
    return Motion.load(path)


def timed(work: Callable[[], None], log: Path) -> float:
    """Returns the seconds of a whole run that nobody kills; a first one warms up."""
    killed(work, 1e9, log)
    began = time.monotonic()
    killed(work, 1e9, log)
    return time.monotonic() - began


def digests(folder: Path) -> dict[str, str]:
    """Returns the SHA-256 of all files of a folder, hidden ones too."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def bulk(place: Path, kills: int, draw: random.Random, count: Count) -> None:
    """Kills `latentmotion bulk`, which resumes."""
    prompts, log = place / "prompts.txt", place / "log"
    prompts.write_text("a person walks\na person jumps\nsomeone waves\n" * 8, encoding="utf-8")
    words = ["bulk", str(prompts), "--rows", "2", "--seconds", "2", "-o"]
    seconds = timed(lambda: run([*words, str(place / f"whole-{time.monotonic_ns()}")]), log)
    whole = min(place.glob("whole-*"))
    while count.kills < kills:
        folder = place / f"killed-{count.results}"
        while killed(lambda: run([*words, str(folder)]), draw.uniform(0, seconds), log):  # noqa: B023
            count.kills += 1
        count.results += 1
        if digests(folder) != digests(whole):
            count.problems.append(f"{folder} differs from the run that nobody killed")


def files(place: Path, kills: int, draw: random.Random, count: Count) -> None:
    """Kills writing of files over older ones."""
    log = place / "log"
    motions = [generated(place / f"motion-{seed}.npz", seed) for seed in range(2)]
    folder, contents = place / "files", []
    folder.mkdir()

    def write(motion: Motion) -> None:
        for ending in FORMATS:
            formats.save(folder / f"a{ending}", [motion])

    for motion in motions:
        write(motion)
        contents.append(digests(folder))
    seconds = timed(lambda: write(motions[0]), log)
    while count.kills < kills:
        motion = motions[count.kills % 2]
        count.kills += killed(lambda: write(motion), draw.uniform(0, seconds), log)  # noqa: B023
        found = digests(folder)
        count.results += len(FORMATS)
        for name in contents[0]:
            if found.get(name) not in [one[name] for one in contents]:
                count.problems.append(f"{name} is neither the old nor the new file")
    write(motions[0])
    if digests(folder) != contents[0]:
        count.problems.append(f"left beside the files: {set(digests(folder)) - set(contents[0])}")


def data(place: Path, kills: int, draw: random.Random, count: Count) -> None:
    """Kills `latentmotion data prepare` over an older folder."""
    log, targets = place / "log", []
    for number in range(2):
        clips = place / f"clips-{number}"
        clips.mkdir()
        for seed in range(4):
            generated(clips / f"{seed}.bvh", seed + number)
    words = ["-o", str(place / "data"), "--generated", "--val", "0", "--test", "0"]
    commands = [["data", "prepare", "own", str(place / f"clips-{n}"), *words] for n in range(2)]
    for words in commands:
        killed(lambda: run(words), 1e9, log)  # noqa: B023
        targets.append(digests(place / "data"))
    seconds = timed(lambda: run(commands[0]), log)
    while count.kills < kills:
        words = commands[count.kills % 2]
        count.kills += killed(lambda: run(words), draw.uniform(0, seconds), log)  # noqa: B023
        count.results += 1
        folder = place / "data"
        if not folder.is_dir():  # killed between two renames: the next run puts it back
            folder = place / ".data.replaced"
        if digests(folder) not in targets:
            count.problems.append(f"{folder} is neither the old nor the new one")


def library(place: Path, kills: int, draw: random.Random, count: Count) -> None:
    """Kills a process that keeps takes in a library."""
    told, log = place / "told", place / "log"
    motion = generated(place / "motion.npz", 0)

    def keep() -> None:
        kept = Library(place / "library")
        with told.open("a", encoding="utf-8", buffering=1) as file:
            for number in range(TAKES):
                joints = motion.joints + number + time.time() % 1
                (take,) = kept.add([(Motion(joints), {"prompt": "walk"}, "walk", Edits())])
                file.write(f"{take.id}\n")
        kept.close()

    seconds = timed(keep, log)
    while count.kills < kills:
        count.kills += killed(keep, draw.uniform(0, seconds), log)
        with sqlite3.connect(place / "library" / "library.sqlite3") as database:
            (state,) = database.execute("PRAGMA integrity_check").fetchone()
        if state != "ok":
            count.problems.append(f"the library is damaged: {state}")
    kept = Library(place / "library")
    for name in told.read_text(encoding="utf-8").split():
        count.results += 1
        try:
            kept.motion(kept.take(name))
        except Exception as error:
            count.problems.append(f"take {name}: {error}")
    kept.close()


def jobs(place: Path, kills: int, draw: random.Random, count: Count) -> None:
    """Kills a service that works at jobs."""
    address = f"http://127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "latentmotion", "serve", "--jobs", str(place / "jobs")]
    command += ["--port", address.rpartition(":")[2]]
    names: list[str] = []
    with httpx.Client(base_url=address, timeout=60) as client:

        def ready() -> None:
            end = time.monotonic() + PATIENCE
            while time.monotonic() < end:
                with suppress(httpx.HTTPError):
                    if client.get("/readyz").status_code == 200:
                        return
                time.sleep(0.05)
            raise TimeoutError("the service was not ready")

        while count.kills < kills:
            with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
                ready()
                names.append(client.post("/v1/jobs", json=JOB).raise_for_status().json()["id"])
                time.sleep(draw.uniform(0, 2))
                process.kill()
            count.kills += 1
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
            ready()
            contents = []
            for name in names:
                end, state = time.monotonic() + PATIENCE, ""
                while state not in ("done", "failed") and time.monotonic() < end:
                    answer = client.get(f"/v1/jobs/{name}")
                    state = answer.json().get("state", "lost")
                    time.sleep(0.1)
                count.results += 1
                if state != "done":
                    count.problems.append(f"job {name}: {state}")
                    continue
                content = client.get(f"/v1/jobs/{name}/result").content
                contents.append(hashlib.sha256(content).hexdigest())
            process.kill()
    if len(set(contents)) > 1:
        count.problems.append("equal jobs have different results")


if __name__ == "__main__":
    main()
