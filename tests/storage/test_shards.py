"""Work in shards: killed at any moment, repeated, checked."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from latentmotion.errors import DataError, InputError
from latentmotion.storage import shards
from latentmotion.storage.shards import (
    ShardContent,
    ShardedRun,
    ShardSubset,
    Work,
    Wrong,
    folder_at,
)

COUNT = 9
NAMES = tuple(f"numbers-{number}.txt" for number in range(COUNT))


def numbers(first: int) -> ShardContent:
    content = "".join(f"{first + number}\n" for number in range(1000)).encode()
    return ShardContent(content, 9, (Wrong(first + 1, "one is wrong"),))


def work(seed: int = 0) -> Work:
    tasks = {name: partial(numbers, 10 * n + seed) for n, name in enumerate(NAMES)}
    return Work(ShardedRun({"seed": seed}, 10 * COUNT, NAMES), tasks)


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def whole(tmp_path: Path) -> dict[str, bytes]:
    manifest = shards.make(work(), folder_at(tmp_path / "whole", create=True))
    assert manifest is not None and len(manifest.shards) == COUNT
    return content(tmp_path / "whole")


# Reads rows of shares and moments, and has a worker for each of a row: it makes shards, but is
# killed before or after a rename, or half through a file. Prints how they ended.
KILLED = """
import os, signal, sys
from pathlib import Path

write, replace = Path.write_bytes, Path.replace

def passes():
    global deadly
    deadly -= 1
    return deadly != 0

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def killed_write(path, content):
    if not passes():
        write(path, content[: len(content) // 2])
        die()
    return write(path, content)

def killed_replace(path, target):
    passes() or die()
    replace(path, target)
    passes() or die()

Path.write_bytes, Path.replace = killed_write, killed_replace

from latentmotion.storage import shards
from latentmotion.storage.shards import folder_at
from tests.storage.test_shards import work

for row in sys.stdin:
    workers = []
    for share, moment in (word.split(":") for word in row.split()):
        if worker := os.fork():
            workers.append(worker)
            continue
        deadly = int(moment)
        folder = folder_at(sys.argv[1], create=True)
        shards.make(work(), folder, shards.ShardSubset.parse(share))
        os._exit(0)
    codes = [os.waitstatus_to_exitcode(os.waitpid(worker, 0)[1]) for worker in workers]
    print(*codes, flush=True)
"""


@pytest.mark.parametrize("shares", [("1/2", "2/2"), ("1/1", "1/1")])
def test_two_workers_killed_at_random_make_the_same_bytes(
    shares: tuple[str, str], whole: dict[str, bytes], tmp_path: Path
) -> None:
    moments, folder, kills = random.Random(3), tmp_path / "parts", 0
    waiting, program = list(shares), [sys.executable, "-c", KILLED, str(folder)]
    pipe = subprocess.PIPE
    with subprocess.Popen(program, stdin=pipe, stdout=pipe, text=True, bufsize=1) as workers:
        assert workers.stdin and workers.stdout
        while waiting:
            row = " ".join(f"{share}:{moments.randint(1, 20)}" for share in waiting)
            workers.stdin.write(f"{row}\n")
            codes = [int(code) for code in workers.stdout.readline().split()]
            assert set(codes) <= {0, -signal.SIGKILL}
            kills += sum(code != 0 for code in codes)
            waiting = [share for share, code in zip(waiting, codes, strict=True) if code]
    assert kills >= 3
    shards.make(work(), folder_at(folder))
    assert content(folder) == whole
    shards.check(folder_at(folder))


def test_finished_shards_are_skipped(whole: dict[str, bytes], tmp_path: Path) -> None:
    made: list[str] = []
    (tmp_path / "whole" / f"{NAMES[4]}.json").unlink()
    again = folder_at(tmp_path / "whole")
    shards.make(work(), again, report=lambda record: made.append(record.name))
    assert made == [NAMES[4]]
    assert content(tmp_path / "whole") == whole


@pytest.mark.parametrize("count", [1, 2, 5, 20])
def test_shares_cover_every_shard_once(count: int, whole: dict[str, bytes], tmp_path: Path) -> None:
    shares = [ShardSubset(number, count) for number in range(1, count + 1)]
    assert sorted(name for share in shares for name in share.of(NAMES)) == sorted(NAMES)
    folder = folder_at(tmp_path / "shared", create=True)
    manifests = [shards.make(work(), folder, share) for share in shares]
    assert manifests[-1] is not None
    assert content(tmp_path / "shared") == whole


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "-1/3", "1/0"])
def test_a_wrong_share_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected a number of a total"):
        ShardSubset.parse(text)


def test_another_run_is_refused(whole: dict[str, bytes], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="another run: seed is 0 there, 1 here"):
        shards.make(work(1), folder_at(tmp_path / "whole"))
    assert content(tmp_path / "whole") == whole


def test_a_shard_of_another_run_is_not_taken(tmp_path: Path) -> None:
    for seed in (0, 1):
        folder = folder_at(tmp_path / str(seed), create=True)
        shards.make(work(seed), folder, ShardSubset(1, 2))
    other = tmp_path / "1" / f"{NAMES[0]}.json"
    (tmp_path / "0" / other.name).write_bytes(other.read_bytes())
    with pytest.raises(DataError, match=r"numbers-0\.txt is of another run"):
        shards.make(work(), folder_at(tmp_path / "0"))


def damaged(name: str, tmp_path: Path) -> None:
    path = tmp_path / "whole" / name
    path.write_bytes(path.read_bytes().replace(b"7", b"8", 1))


def test_a_check_finds_changes_gaps_and_missing_items(
    whole: dict[str, bytes], tmp_path: Path
) -> None:
    folder, path = folder_at(tmp_path / "whole"), tmp_path / "whole"
    damaged(NAMES[2], tmp_path)
    (path / NAMES[3]).unlink()
    (path / NAMES[5]).write_bytes(b"")
    with pytest.raises(DataError) as told:
        shards.check(folder)
    assert f"{NAMES[2]} has another content, {NAMES[3]} is missing, {NAMES[5]} has 0" in str(
        told.value
    )
    for name in NAMES:
        (path / name).write_bytes(whole[name])
    manifest = json.loads(whole["manifest.json"])
    manifest["shards"][0]["items"] = 8
    (path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match="89 items, expected 90"):
        shards.check(folder)


def test_a_check_names_what_is_not_finished(tmp_path: Path) -> None:
    folder = folder_at(tmp_path / "run", create=True)
    with pytest.raises(DataError, match=r"no run: it has no run\.json"):
        shards.check(folder)
    shards.make(work(), folder, ShardSubset(2, 2))
    with pytest.raises(DataError, match=r"5 of 9 files are missing \(numbers-0.txt, .*, …\)"):
        shards.check(folder)


def test_an_address_is_no_folder() -> None:
    with pytest.raises(InputError, match="is an address; expected a folder"):
        folder_at("s3://bucket/motions", create=True)
