"""Lists and tables of the measurements that no training sees; the tower that ranks clips."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.quality.acts import __main__ as acts
from benchmarks.quality.acts import sheets, table
from benchmarks.quality.own_clip import __main__ as own_clip
from benchmarks.quality.own_clip import words
from benchmarks.quality.own_clip.tower import WEIGHTS, Tower
from latentmotion import Motion
from latentmotion.kinematics.skeleton import HUMANML3D
from tests.support import acted

LISTS = table.ACTS.parent


def test_every_act_has_five_prompts_of_its_own() -> None:
    listed = table.read_acts()
    assert len(listed) == len({act.name for act in listed}) >= 150
    prompts = [prompt for act in listed for prompt in act.prompts]
    assert len(prompts) == len(set(prompts)) == table.PROMPTS * len(listed)
    for act in listed:
        assert re.compile(act.captions) and act.clips > 0 and act.seconds > 0
    counts = [sum(act.stratum == stratum for act in listed) for stratum in table.STRATA]
    assert min(counts) >= 40 and sum(counts) == len(listed)


def test_lists_of_prompts_are_whole() -> None:
    foreign, known = table.rows_of(LISTS / "foreign.tsv"), table.rows_of(LISTS / "known.tsv")
    typos = table.rows_of(LISTS / "typos.tsv")
    assert (len(foreign), len(known), len(typos)) == (200, 200, 40)
    assert not {row["prompt"] for row in foreign} & {row["prompt"] for row in known}
    assert all(row["kind"] and row["prompt"] for row in foreign)
    assert not [row for row in typos if row["intended"] in row["prompt"].split()]


def test_verdicts_are_counted_by_act(tmp_path: Path) -> None:
    one = table.Judged(0, "kick", 3, "kick!", 0, 2.0, "kicks", "good")
    judged = [one, replace(one, number=1, verdict="bad"), replace(one, act="wave", clips=99)]
    table.write_judged(judged, tmp_path / "v.tsv")
    assert table.read_judged(tmp_path / "v.tsv") == judged
    lines = table.report(judged).splitlines()
    assert lines[2].startswith("| 1 to 5 clips | 1 | 2 | 1 | 0 | 1 | 50% |")
    assert lines[-1].startswith("| all | 2 | 3 | 2 | 0 | 1 | 75% |")
    with pytest.raises(ValueError, match="number 0: verdict 'fine'"):
        table.report([replace(one, verdict="fine")])


def test_the_kept_verdicts_are_whole() -> None:
    for path in (LISTS / "verdicts").iterdir():
        assert table.report(table.read_judged(path))


def test_names_come_before_the_key(tmp_path: Path) -> None:
    table.write_judged([table.Judged(0, "kick", 3, "kick!", 0, 2.0)], tmp_path / "key.tsv")
    (tmp_path / "names.tsv").write_text("number\tnamed\n0\t\n")
    with pytest.raises(SystemExit, match="before the key is opened"):
        acts.Reveal(tmp_path / "key.tsv", tmp_path / "names.tsv", tmp_path / "v.tsv").run()
    assert not (tmp_path / "v.tsv").exists()


def test_the_way_leads_up_where_the_body_goes_ahead() -> None:
    joints = acted.elsewhere(acted.walk(2, 1.0), 70)
    path, front = sheets._seen_from_start(Motion(joints, 20.0, HUMANML3D))
    assert path[-1, 1] > 1.5 and abs(path[-1, 0]) < 0.3
    assert front[0] == pytest.approx([0, 1], abs=1e-6)
    left, _ = sheets._seen_from_start(Motion(acted.walk(2, 1.0, 90), 20.0, HUMANML3D))
    assert left[-1, 0] < -1.5


def test_a_clip_is_its_own_nearest() -> None:
    tower, generator = Tower.load(), np.random.default_rng(0)
    motions = [generator.normal(0, 0.3, (40 + 8 * n, 263)).astype(np.float32) for n in range(6)]
    assert (own_clip.ranks_of(motions, motions, tower) == 1).all()
    assert own_clip.ranks_of(motions[:1] * 2, motions[1:3], tower).min() >= 1
    assert WEIGHTS.stat().st_size <= 3 * 2**20


def test_half_of_the_captions_is_kept_from_the_tower() -> None:
    captions = [f"a person walks {n} steps" for n in range(400)]
    assert 0.4 < np.mean([words.is_trained_on(caption) for caption in captions]) < 0.6
    assert words.is_trained_on("He waves.") == words.is_trained_on("he waves")
    assert words.content_words("A person slowly kicks the ball") == ["slowly", "kicks", "ball"]


def test_strata_have_lines_with_intervals() -> None:
    ranks, strata = np.array([1, 3, 40, 2]), np.array(["< 10", "< 10", "more", "more"])
    lines = own_clip.lines_of("x", ranks, strata)
    assert [line.split(" | ")[1] for line in lines] == ["< 10", "more", "all"]
    assert lines[0].startswith("| x | < 10 | 2 | 2 (1 to 3) | 50 % (0 to 100) | 100 %")
