"""Benchmarks run with tiny settings, so that they do not rot; nobody asserts times."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from importlib.util import find_spec
from itertools import count, cycle, islice
from pathlib import Path

import numpy as np
import pytest
import torch

import benchmarks.__main__ as everything
from benchmarks.generation import (
    bulk,
    cold_start,
    files,
    first_motion,
    growth,
    livez,
    render,
    soak,
    speed,
    text_encoder,
)
from benchmarks.generation.authors import AuthorsGeneration
from benchmarks.generation.ours import Generation, Model, sentences
from benchmarks.harness import authors_networks, contest, load, process, replicas
from benchmarks.quality import dynamics, wordings
from benchmarks.training import device as device_training
from benchmarks.training import kills
from benchmarks.training import speed as training
from latentmotion import MotionPipeline
from latentmotion.errors import InputError
from tests.support import stub_service
from tests.support.moving_figures import write_moving_figures

ROOT = Path(__file__).parents[1]
QUICK = ["--engines", "onnxruntime", "--threads", "1", "--seconds", "1", "--turns", "1"]


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch):
    """Authors' shapes of one layer and few words; the threads of other tests as they were."""
    for name, value in (("TEXT_LAYERS", 1), ("WORDS", 100), ("LAYERS", 1)):
        monkeypatch.setattr(authors_networks, name, value)
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)


def rows(printed: str) -> dict[str, list[str]]:
    """Cells of all tables by the first one of their rows."""
    lines = [line.strip("| ").split(" | ") for line in printed.splitlines() if line[:1] == "|"]
    return {cells[0]: cells[1:] for cells in lines}


def numbers(cells: list[str]) -> list[float]:
    return [float(cell.strip("*")) for cell in cells if cell.strip()]


def weights(network: torch.nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())


def test_contenders_take_turns_and_the_first_turn_is_thrown_away():
    order = []

    def contender(name: str, paces: list[float]) -> contest.Contender:
        turns = iter(paces)

        def run() -> contest.Laps:
            order.append(name)
            return {"a": next(turns), "b": 1.0}

        return run

    pair = {"slow": contender("slow", [99, 3, 7, 5]), "fast": contender("fast", [99, 1, 3, 0])}
    times = contest.take_turns(pair, turns=3)
    assert order == ["slow", "fast"] * 4
    assert times.part("slow", "a") == 5
    assert times.whole("fast") == 2
    assert times.ratio("fast") == 2  # medians of 4/2, 8/4 and 6/1
    assert "medians of turns: 3" in str(times)


def test_an_impatient_contest_leaves_slow_contenders_out_after_one_turn():
    turns = count()
    times = contest.take_turns({"a": lambda: {"a": 1.0 + next(turns)}}, turns=5, patience=0)
    assert [turn.whole for turn in times.turns["a"]] == [2.0]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.01234, "0.0123"), (1.0, "1.00"), (12.34, "12.3"), (99.96, "100"), (1234.5, "1234")],
)
def test_figures_have_three_digits(value: float, text: str):
    assert contest.figure(value) == text
    assert contest.figure(float("nan")) == ""


def test_sentences_are_all_different():
    assert len(set(islice(sentences(), 1000))) == 1000


def test_bulk_counts_what_its_processes_make(capsys):
    bulk.main(["3", "--processes", "2", "--options", "rows=2", "seconds=1"])
    (cells,) = [cells for name, cells in rows(capsys.readouterr().out).items() if name == "3"]
    processes, size, clock, pace, *_ = numbers(cells)
    assert (processes, pace) == (2, pytest.approx(3 / clock, rel=0.02)) and size > 0


def test_the_authors_shapes_have_the_published_numbers_of_weights(monkeypatch):
    monkeypatch.setattr(authors_networks, "LAYERS", 9)
    tower, layer = authors_networks.TextTower(), authors_networks.TextLayer(768)
    assert weights(tower) + 11 * weights(layer) + (49408 - 100) * 768 == 123_650_304
    assert weights(authors_networks.VAE(263, 498)) == 18_032_135


def test_the_authors_order_of_work_gives_every_part():
    laps = AuthorsGeneration(batch=2, frames=20, steps=3)()
    assert list(laps) == list(speed.PARTS)
    assert min(laps.values()) > 0


def test_speed_prints_a_row_for_each_contender(capsys):
    models = ["--models", "mine=starter", "--steps", "2"]
    engines = ["--engines", "onnxruntime", "pytorch"]
    speed.main([*models, *QUICK, *engines, "--batches", "2", "--processes", "0"])
    found = rows(capsys.readouterr().out)
    assert "MDM's shape, 1000 steps (reckoned from 1)" in found
    assert len(numbers(found["mine, 2 steps, PyTorch eager"])) == 8
    text, denoiser, decoder, joints, whole, each, ratio, _ = numbers(
        found["mine, 2 steps, ONNX Runtime"]
    )
    assert text + denoiser + decoder + joints == pytest.approx(whole, rel=0.02)
    assert each == pytest.approx(whole / 2, rel=0.02)
    first = numbers(found["authors' shapes, 2 steps"])
    assert ratio == pytest.approx(first[4] / whole, rel=0.02)


def test_one_graph_for_all_is_called_denoiser():
    generator = MotionPipeline.from_pretrained("starter", "onnxruntime", threads=1)

    def graph(noise: np.ndarray, frames: np.ndarray, **others: np.ndarray) -> np.ndarray:
        return np.zeros((*frames.shape, 263), np.float32)

    folded = replace(generator, backend=replace(generator.backend, fused={1: graph}))
    assert list(Generation(folded, 1, 1.0, 1)()) == ["text", "denoiser", "joints"]
    assert set(Generation(folded, 1, 1.0, 2)()) == set(speed.PARTS)


def test_growth_prints_three_tables_and_their_lines(capsys):
    axes = ["--lengths", "1", "2", "--batches", "1", "2", "--counts", "1", "2"]
    growth.main([*axes, *QUICK, "--steps", "2"])
    printed = capsys.readouterr().out
    assert {"seconds", "motions", "steps"} <= set(rows(printed))
    assert len(re.findall(r"ms, and [-+.\de]+ ms for each (second|motion|step)\.", printed)) == 3


def test_training_prints_every_stage(capsys):
    tiny = ["--first", "2", "--second", "2", "--frames", "16", "--turns", "1", "--threads", "1"]
    training.main([*tiny, "--presets", "starter"])
    found = rows(capsys.readouterr().out)
    for name in ("ours, `starter`", "of `starter`, trajectories"):
        motions, frames, seconds, _, per_second, *_ = numbers(found[name])
        assert per_second == pytest.approx(motions / seconds, rel=0.02)
        assert frames == 16


def test_training_on_a_device_has_a_line_for_each_stage_and_precision(monkeypatch):
    monkeypatch.setattr(device_training, "FRAMES", 16)
    found = list(device_training.training_rows("cpu", quick=True))
    assert [name.split()[1] for name, _ in found] == ["first", "first", "second", "second"]
    assert [row["precision"] for _, row in found] == ["float32", "bfloat16"] * 2


@pytest.mark.parametrize("differs", [False, True])
def test_killed_trainings_are_counted(monkeypatch, capsys, tmp_path, differs):
    def train(words: Sequence[str], folder: Path) -> None:
        """Ends when it is killed if it starts for the first time, else at once."""
        sum(range(300_000))  # so that the whole run takes some time
        (folder / "model").mkdir(parents=True, exist_ok=True)
        (folder / "starts").open("a").write("x")
        starts = (folder / "starts").read_text()
        while starts == "x" and folder.name.startswith("killed"):
            pass
        (folder / "model" / kills.WEIGHTS_FILE).write_text(starts if differs else "same")
        os._exit(0)

    monkeypatch.setattr(kills, "_train", train)
    kills.main([str(tmp_path), "--kills", "2"])
    told = re.search(r"(\d+) kills in (\d+) runs; (\d+) of them differ", capsys.readouterr().out)
    killed, runs, different = map(int, told.groups())
    assert killed >= 2 and runs >= 1 and different == runs * differs


@pytest.mark.skipif(os.name == "nt", reason="needs fork")
def test_killed_commands_are_counted(tmp_path):
    root = Path(__file__).parents[1]
    words = [sys.executable, "-m", "benchmarks.generation.kills", "--kills", "2", "--only", "files"]
    paths = {"PYTHONPATH": f"{root}{os.pathsep}{root / 'src'}"}
    told = subprocess.run(
        words, cwd=tmp_path, env=os.environ | paths, check=True, capture_output=True, text=True
    ).stdout
    kills, checked, problems = map(int, rows(told)["files"])
    assert kills == 2 and checked >= 10 and problems == 0


def test_health_checks_are_compared_with_a_bare_server(capsys):
    livez.main(["--seconds", "1", "--idle", "30"])
    told = rows(capsys.readouterr().out)
    names = ("the service", "a bare server", "ratio")
    (_, median, p99, most), (_, bare, *_), (ratio, *_) = (numbers(told[name]) for name in names)
    assert 0 < median <= p99 <= most
    assert ratio == pytest.approx(median / bare, rel=0.05)


def test_a_process_tells_its_peak_of_memory():
    code = "x = bytearray(200_000_000); print(len(x))"
    cost = process.cost([sys.executable, "-c", code])
    assert cost.said.strip() == "200000000"
    assert 200 < cost.memory < 300
    assert 0 < cost.processor < 10 * cost.clock


def test_a_first_motion_has_import_load_and_two_motions():
    laps = first_motion.ours(str(Model.of("starter").folder), "onnxruntime", "1", "1", "2")
    assert list(laps) == ["import", "load", "first motion", "second"]


def test_a_cold_start_asks_for_what_users_type(monkeypatch, capsys):
    commands = []

    def cost(command: list[str], **environment: str) -> process.Cost:
        commands.append((command, environment))
        said = '{"import": 10.0, "load": 20.0, "first motion": 30.0}'
        return process.Cost(clock=0.5, processor=0.4, memory=150.0, said=said)

    monkeypatch.setattr(cold_start, "cost", cost)
    cold_start.main(["--models", "mine=starter", *QUICK])
    found = rows(capsys.readouterr().out)
    assert found["mine, 50 steps, ONNX Runtime"] == ["10.0", "20.0", "30.0", "500", "150"]
    command = next(command for command, _ in commands if "latentmotion" in command)
    assert command[1:4] == ["-m", "latentmotion", "generate"]
    assert {environment["OMP_NUM_THREADS"] for _, environment in commands} == {"1"}


def test_files_are_timed_by_format(monkeypatch, capsys):
    monkeypatch.setattr(files, "ENDINGS", (".bvh", ".csv"))
    files.main(["--seconds", "1", "--turns", "1"])
    assert {"clean-up", ".bvh", ".csv"} <= set(rows(capsys.readouterr().out))


def test_text_encoders_take_turns(monkeypatch, capsys):
    load = text_encoder.StudentTextEncoder.load
    starter = Model.of("starter").folder
    monkeypatch.setattr(text_encoder.PretrainedTextEncoder, "load", lambda name: load(starter))
    text_encoder.main(["--turns", "2"])
    printed = capsys.readouterr().out
    assert "mean cosine 1.0000" in printed
    assert {"ours", "MiniLM, transformers"} <= set(rows(printed))


def test_pictures_are_made_by_the_command(monkeypatch, capsys):
    def cost(command: list[str]) -> process.Cost:
        Path(command[command.index("-o") + 1]).write_bytes(bytes(2000))
        return process.Cost(clock=1.5, processor=1.25, memory=0.0, said="")

    monkeypatch.setattr(render, "cost", cost)
    render.main(["--turns", "1"])
    assert rows(capsys.readouterr().out)["GIF"] == ["1.50", "1.25", "2"]


def test_the_page_is_filled_by_name(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- one -->\nold\n<!-- end of one -->\nb\n<!-- two -->\n<!-- end of two -->")
    (tmp_path / "one.md").write_text("new\n")
    everything.fill(page, tmp_path)
    kept = "\nb\n<!-- two -->\n<!-- end of two -->"
    assert page.read_text() == f"<!-- one -->\nnew\n<!-- end of one -->{kept}"


def test_every_table_of_the_page_has_a_program(monkeypatch, tmp_path):
    ran = {}
    monkeypatch.setattr(everything, "_printed", lambda words: ran.setdefault(str(words), "table"))
    everything.main([str(tmp_path), "--models", "starter", "--int8", "small=starter"])
    named = set(re.findall(r"<!-- (\w+) -->", (ROOT / "lab/diary/performance.md").read_text()))
    assert named == {path.stem for path in tmp_path.iterdir()}
    assert all(find_spec("benchmarks." + words.split("'")[1]) for words in ran)


def test_a_request_on_a_connection_that_was_kept_in_vain_is_sent_again():
    seen = []

    async def answer(reader, writer):
        """Answers one request, and takes the next without a word."""
        with suppress(asyncio.IncompleteReadError), closing(writer):
            for content in (b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n", b""):
                seen.append(await reader.readuntil(b"\r\n\r\n"))
                writer.write(content)

    async def run():
        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        place = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        found = await load.load(place, cycle([("a", load.request("GET", "/"))]), 2, 1.0)
        server.close()
        return found

    times = asyncio.run(run())
    assert {name: len(found) for name, found in times.items()} == {"a 200": 1, "a again 200": 1}
    assert len(seen) == 3


def soaked(monkeypatch, capsys, tmp_path, *options):
    """Returns what a soak of a stub tells, and its rows before SIGTERM for all."""
    for name, value in {"LAST": 1.0, "WARM": 0.5, "GONE": 0.1, "NOTICE": 0}.items():
        monkeypatch.setattr(soak, name, value)
    monkeypatch.setattr(replicas, "SERVE", stub_service.COMMAND)
    monkeypatch.setattr(soak.os, "nice", lambda more: more)
    file = tmp_path / "soak.md"
    soak.main(["--rate", "20", "--minutes", "0.03", "--output", str(file), *options])
    told = capsys.readouterr().out
    assert file.read_text() == told.removesuffix("\n")
    before = told.partition("Before SIGTERM")[2].partition("Around SIGTERM")[0]
    assert told.partition("Around SIGTERM")[2] and "s after SIGTERM" in told
    return told, {
        name: int(cells[0]) for name, cells in rows(before).items() if cells[0].isdecimal()
    }


def test_the_soak_counts_what_happens(monkeypatch, capsys, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    options = ["--replicas", "1", "--small-disk", str(disk)]
    told, before = soaked(monkeypatch, capsys, tmp_path, *options)
    found = {name: times for name, times in before.items() if name[-3:].isdecimal()}
    assert found == {"raw 200": 29, "GLB 429": 4, "livez 200": 3}
    happened = rows(told)
    for event in ("stream: 1001 going", "pieces of a stream", "hung", "jobs: 202"):
        assert int(happened[event][0]) >= 1


@pytest.mark.skipif(
    shutil.which("caddy") is None, reason="needs a balancer (Debian: apt-get install caddy)"
)
def test_a_killed_replica_behind_the_balancer_loses_nothing(monkeypatch, capsys, tmp_path):
    told, before = soaked(monkeypatch, capsys, tmp_path)
    assert told.index("the last replica is killed") < told.index("it is ready again")
    assert told.count("it is ready again") == 2
    assert sum(before.values()) == 36
    assert {name.split()[-1] for name in before} <= {"200", "429", "503"}


def test_lost_requests_are_sent_again_as_they_are_told_by_a_balancer(monkeypatch):
    async def run():
        answers = iter(("502 Bad Gateway", "504 Gateway Timeout", "200 OK", *["502 Bad"] * 4))

        async def answer(reader, writer):
            with suppress(asyncio.IncompleteReadError), closing(writer):
                while await reader.readuntil(b"\r\n\r\n"):
                    writer.write(f"HTTP/1.1 {next(answers)}\r\nContent-Length: 0\r\n\r\n".encode())

        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        place = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        asked = cycle([("a", load.request("GET", "/"))])
        found = [await load.load(place, asked, 1, 1.0) for _ in range(2)]
        server.close()
        return [list(times) for times in found]

    monkeypatch.setattr(load, "PAUSES", (0.0, 0.0, 0.0))
    assert asyncio.run(run()) == [["a 502 504 200"], ["a 502 502 502 502"]]


def test_a_service_is_kept_busy(monkeypatch):
    async def run():
        together, most = 0, 0

        async def answer(reader, writer):
            nonlocal together, most
            with suppress(asyncio.IncompleteReadError), closing(writer):
                while await reader.readuntil(b"\r\n\r\n"):
                    together += 1
                    most = max(most, together)
                    await asyncio.sleep(0.01)
                    together -= 1
                    writer.write(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n")

        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        place = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        asked = cycle([("a", load.request("GET", "/"))])
        found = await load.saturate(place, asked, 3, 0.2)
        server.close()
        return most, found

    most, found = asyncio.run(run())
    assert most == 3 and list(found) == ["a 200"] and len(found["a 200"]) >= 3


def test_load_counts_answers_and_lost_connections():
    talks = set()

    async def answer(reader, writer):
        talks.add(asyncio.current_task())
        while b"/good" in await reader.readline():
            await reader.readuntil(b"\r\n\r\n")
            writer.write(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nok")
        writer.close()

    async def run():
        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        place = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        asked = cycle((name, load.request("GET", f"/{name}")) for name in ("good", "gone"))
        found = await load.load(place, asked, 1000, 0.02)
        server.close()
        await asyncio.gather(*talks)
        return found

    times = asyncio.run(run())
    counts = Counter()
    for name, found in times.items():
        counts[name if name == "good 200" else f"{name.split()[0]} lost"] += len(found)
    assert counts == {"good 200": 10, "gone lost": 10}


def test_every_caption_of_the_list_has_other_words():
    pairs = wordings.read_pairs(wordings.LIST)
    sentences = [sentence for pair in pairs for sentence in pair]
    assert len(pairs) == 96 and len(set(sentences)) == 192


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a person runs", "line 1: 'a person runs'"),
        ("a person runs\tsprint\tdash", "line 1"),
        ("", "0 lines; expected groups of 32"),
        ("a person runs\tsprint\n", "1 lines"),
    ],
)
def test_a_list_of_wordings_is_pairs_in_full_groups(tmp_path, text, message):
    file = tmp_path / "list.tsv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        wordings.read_pairs(file)


def test_own_wordings_are_compared_line_by_line():
    # Three lines, two seeds: as good, worse by its share, worse by its place alone.
    places = wordings.Places(np.array([[0, 2], [0, 0], [0, 0]]), np.array([[2, 0], [3, 9], [1, 1]]))
    first, third = wordings.shares(places)
    assert [cell.split()[0] for cell in first[1:]] == ["0.833", "0.167", "0.200"]
    assert [cell.split()[0] for cell in third[1:]] == ["1.000", "0.667", "0.667"]
    assert third[1] == "1.000 (1.000–1.000)" and third[3].endswith("(0.000–1.000)")
    lines = wordings.worst([("a", "b"), ("c", "d"), ("e", "f")], places, 2)
    assert lines == [["c", "d", "1.0 → 0.0", "1 → 7"], ["e", "f", "1.0 → 1.0", "1 → 2"]]


def test_a_caption_is_told_better_than_another_movement(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(wordings, "GROUP", 4)
    captions = [pair[0] for pair in wordings.read_pairs(wordings.LIST)[:4]]
    file, out = tmp_path / "list.tsv", tmp_path / "places.csv"
    own = [*captions[1:], captions[0]]
    file.write_text("".join(f"{pair[0]}\t{pair[1]}\n" for pair in zip(captions, own, strict=True)))
    wordings.main(wordings.Wordings("fast", file, seeds=(0,), worst=1, out=out))
    (cells,) = [cells for name, cells in rows(capsys.readouterr().out).items() if "@1" in name]
    right, wrong, _ = (float(cell.split()[0]) for cell in cells)
    assert right > wrong
    assert len(out.read_text().splitlines()) == 5


@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.UnknownWordsWarning")
def test_dynamics_of_files_stand_beside_real_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    motion = MotionPipeline.from_pretrained("fast", threads=1)("a person walks", 2.0, takes=1)
    motion.save(tmp_path / "walk.npz")
    motion.save(tmp_path / "walk.bvh")
    files = [str(tmp_path / "walk.npz"), str(tmp_path / "walk.bvh")]
    data = ["--data", str(write_moving_figures(tmp_path / "real", test=8))]
    monkeypatch.setattr(sys, "argv", ["dynamics", "files", *files, *data])
    dynamics.main()
    table = rows(capsys.readouterr().out)
    assert {"walk.npz", "walk.bvh", "all files", "real, matched"} <= set(table)
    jerks = [float(table[name][1]) for name in ("walk.npz", "walk.bvh")]
    assert jerks[0] == pytest.approx(jerks[1], rel=0.2) and jerks[0] > 10
