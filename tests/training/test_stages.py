from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from latentmotion.cli.main import main
from latentmotion.data.store import read_manifest
from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.samplers import DDIM
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import find_model
from latentmotion.networks import device
from latentmotion.networks.checkpoint import build, load_model, load_stages
from latentmotion.storage.configuration import read_json, write_json
from latentmotion.training.distributed import DistributedContext, Ranks, distributed_context
from latentmotion.training.experiment import PRESETS, Experiment, preset_named, with_changes
from latentmotion.training.run_folder import Previews, read_journal, read_run
from latentmotion.training.stages import train_denoiser, train_vae, with_networks_of
from latentmotion.training.vae import VAEStage
from tests.support.moving_figures import write_moving_figures
from tests.support.small_training import CHANGES, CONTEXT, LetterCount, killed_at, small


def weights(folder: Path) -> bytes:
    return (folder / "model" / "weights.safetensors").read_bytes()


def test_a_vae_is_trained_into_a_model_folder(vae_run: Path) -> None:
    model = load_stages(vae_run / "model")
    assert list(model.networks) == ["vae"]
    assert model.card.figures["vae_val_mm"] > 0
    assert model.card.provenance.license == "CC0-1.0"
    assert list((vae_run / "tensorboard").iterdir())


def test_a_denoiser_is_trained_on_its_latents(figures: Path, vae_run: Path, tmp_path: Path) -> None:
    experiment = small(**{"denoiser_training.sample_every": 8})
    folder = train_denoiser(experiment, figures, vae_run, LetterCount(), tmp_path / "run", CONTEXT)
    model = load_model(folder)
    assert model.card.latents.frames_per_token == 4
    assert len(model.card.latents.std) == 4 and min(model.card.latents.std) > 0
    assert model.card.condition.encoder == "letter-count"
    assert model.card.condition.condition_width == 6
    assert len(model.card.provenance.commands) == 2
    lines = read_journal(tmp_path / "run")
    assert [line["step"] for line in lines if line["kind"] == "train"] == list(range(1, 9))
    shares = {"prompt_saves_50", "prompt_saves_90"}
    measured = {"step", "kind", "loss", "loss_of_seen", "latent_size", *shares}
    assert all(set(line) == measured for line in lines if line["kind"] == "validation")
    assert all(0 < abs(lines[-1][share]) < 1 for share in shares)
    assert 0.1 < lines[-1]["latent_size"] < 10
    assert (tmp_path / "run" / "samples-0000008.png").stat().st_size > 1000


def test_training_starts_from_another_denoiser_on_the_same_latents(
    figures: Path, vae_run: Path, tmp_path: Path
) -> None:
    def run(name: str, start: Path | None = None, **changes: int) -> Path:
        settings = small(**{f"denoiser_training.{key}": value for key, value in changes.items()})
        return train_denoiser(
            settings, figures, vae_run, LetterCount(), tmp_path / name, CONTEXT, start
        )

    first = run("first")
    second = run("second", first, seed=1, steps=1, warm_up=1000)
    before, after = load_model(first), load_model(second)
    assert after.card.latents == before.card.latents
    for one, other in zip(before.denoiser.parameters(), after.denoiser.parameters(), strict=True):
        assert torch.allclose(one, other, atol=1e-4)
    with pytest.raises(InputError, match=r"differing: parents\.start"):
        run("second", None, seed=1, steps=1, warm_up=1000)
    with pytest.raises(InputError, match="its denoiser is not that of"):
        run("third", find_model("starter"))


def test_samples_are_decoded_where_their_latents_are(vae_run: Path) -> None:
    model = load_stages(vae_run / "model")
    previews, sampler = Previews(model.vae, model.card, 8), DDIM(model.card.schedule)
    mask = torch.ones(1, 1, dtype=torch.bool, device="meta")
    condition = Conditioning(torch.zeros(1, 1, 6, device="meta"), mask)
    with pytest.raises(NotImplementedError, match="out of meta tensor"):  # the way back to the host
        previews.sample(lambda z, *_: (z, z), sampler, 1, condition, [""])
    assert {parameter.device.type for parameter in model.vae.parameters()} == {"meta"}


def test_an_interrupted_second_stage_goes_on_bit_for_bit(
    figures: Path, vae_run: Path, tmp_path: Path
) -> None:
    def run(name: str) -> None:
        train_denoiser(small(), figures, vae_run, LetterCount(), tmp_path / name, CONTEXT)

    run("whole")
    with killed_at(5):
        run("parts")
    run("parts")
    assert weights(tmp_path / "whole") == weights(tmp_path / "parts")


# Trains several times, but is killed before a step or while it writes the snapshot of one; says how
# each ended and whether there is a model. PyTorch is imported once for all.
KILLED = """
import os, signal, sys, torch
from latentmotion.cli.main import main
from latentmotion.training import loop

optimize, save = loop.optimize, torch.save

def killed_optimize(*arguments):
    if kind == "step" and arguments[3] == int(step):
        os.kill(os.getpid(), signal.SIGKILL)
    return optimize(*arguments)

def killed_save(state, path):
    save(state, path)
    if kind == "snapshot" and state["step"] == int(step):
        os.truncate(path, os.path.getsize(path) // 2)
        os.kill(os.getpid(), signal.SIGKILL)

loop.optimize, torch.save = killed_optimize, killed_save
whens, folder, *words = sys.argv[1:]
for when in whens.split(", "):
    kind, step = when.split()
    if os.fork() == 0:
        main(words)
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.wait()[1])
    print(code, os.path.exists(folder + "/model"), flush=True)
"""


def command(data: Path, folder: Path) -> list[str]:
    changes = [f"--set={key}={json.dumps(value)}" for key, value in CHANGES.items()]
    return ["train", "vae", "--data", str(data), "-o", str(folder), *changes]


def environment() -> dict[str, str]:
    return {**os.environ, "OMP_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}


def test_a_killed_run_goes_on_bit_for_bit(figures: Path, vae_run: Path, tmp_path: Path) -> None:
    words = [sys.executable, "-c", KILLED, "step 3, snapshot 6, never 0", str(tmp_path)]
    words += command(figures, tmp_path)
    done = subprocess.run(words, env=environment(), capture_output=True, text=True)
    ends = [line for line in done.stdout.splitlines() if line.endswith(("True", "False"))]
    assert ends == ["-9 False", "-9 False", "0 True"], done.stderr
    assert weights(vae_run) == weights(tmp_path)
    assert read_journal(vae_run) == read_journal(tmp_path)


TORCHRUN = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
TORCHRUN += ["--local-addr=127.0.0.1", "--nproc-per-node=2"]  # No name is looked up.


def test_two_ranks_have_the_losses_of_one(figures: Path, vae_run: Path, tmp_path: Path) -> None:
    words = [*TORCHRUN, "-m", "--", "latentmotion", *command(figures, tmp_path)]
    done = subprocess.run(words, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    one, two = read_journal(vae_run), read_journal(tmp_path)
    assert [line["step"] for line in one] == [line["step"] for line in two]
    for first, second in zip(one, two, strict=True):
        figures_of = [[v for v in line.values() if v != line["kind"]] for line in (first, second)]
        np.testing.assert_allclose(*figures_of, rtol=2e-3)


KILLED_RANK = """
import os, signal, time
from latentmotion.cli.main import main
from latentmotion.training import loop

optimize, start = loop.optimize, os.environ["RANK"] + os.environ["TORCHELASTIC_RESTART_COUNT"]
if start == "11":
    time.sleep(float(os.environ["LATE"]))

def killed_optimize(*arguments):
    if start == "10" and arguments[3] == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    return optimize(*arguments)

loop.optimize = killed_optimize
main()
"""
"""Trains as one rank of several, the second of which is killed before step 5 of its first start.

It comes late to the second, so that the leading rank could find the address of the killed one.
"""


@pytest.mark.skipif("LATENTMOTION_SLOW" not in os.environ, reason="20 s; set LATENTMOTION_SLOW")
def test_torchrun_restarts_killed_ranks_to_the_same_bits(figures: Path, tmp_path: Path) -> None:
    script = tmp_path / "killed_rank.py"
    script.write_text(KILLED_RANK)
    for name, program in (("whole", ["-m", "--", "latentmotion"]), ("parts", ["--", str(script)])):
        words = [*TORCHRUN, "--max-restarts=1", *program, *command(figures, tmp_path / name)]
        late = environment() | {"LATE": "10"}
        done = subprocess.run(words, env=late, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert "exitcode: -9" in done.stderr
    assert weights(tmp_path / "whole") == weights(tmp_path / "parts")
    assert read_journal(tmp_path / "whole") == read_journal(tmp_path / "parts")


@pytest.mark.parametrize(("hosts", "keys"), [("1", ["start 2/key"]), ("2", ["key"])])
def test_each_start_on_a_host_has_keys_of_its_own(
    monkeypatch: pytest.MonkeyPatch, hosts: str, keys: list[str]
) -> None:
    found: list[Any] = []
    store = torch.distributed.HashStore()  # pyright: ignore[reportPrivateImportUsage]
    about = {"WORLD_SIZE": "2", "TORCHELASTIC_RESTART_COUNT": "2", "GROUP_WORLD_SIZE": hosts}
    for name, value in about.items():
        monkeypatch.setenv(name, value)

    def stop(backend: str, **options: Any) -> None:
        found.append(options["store"])
        raise KeyboardInterrupt

    module = "latentmotion.training.distributed"
    monkeypatch.setattr(f"{module}.rendezvous", lambda _: iter([(store, 0, 2)]))
    monkeypatch.setattr(torch.distributed, "init_process_group", stop)
    with pytest.raises(KeyboardInterrupt), distributed_context("cpu"):
        pass
    found[0].set("key", "value")
    assert store.check(keys)


def test_torchrun_takes_our_options() -> None:
    from torch.distributed.run import parse_args

    words = ["train", "denoiser", "--start", "starter"]
    read = parse_args(["--nproc-per-node", "2", "-m", "--", "latentmotion", *words])
    assert read.module and [read.training_script, *read.training_script_args] == [
        "latentmotion",
        *words,
    ]


def test_each_rank_has_its_share_of_the_batch(figures: Path, vae_run: Path) -> None:
    from latentmotion.data.dataset import Dataset

    def losses(ranks: Ranks) -> float:
        torch.manual_seed(0)
        experiment = small()
        place = DistributedContext(torch.device("cpu"), ranks)
        stage = VAEStage(build(experiment.vae), Dataset.load(figures), experiment, place)
        return float(stage(3)["total"].detach())

    halves = [losses(Ranks(rank, 2)) for rank in range(2)]
    assert halves[0] != halves[1]
    assert np.mean(halves) == pytest.approx(losses(Ranks()), rel=1e-5)


def test_another_configuration_is_refused(figures: Path, vae_run: Path) -> None:
    changed = small(**{"vae_training.learning_rate": 0.5})
    with pytest.raises(InputError, match=r"vae_training.learning_rate \(0.0007 → 0.5\)"):
        train_vae(changed, figures, vae_run, CONTEXT)


def test_other_data_is_refused(vae_run: Path, tmp_path: Path) -> None:
    other = write_moving_figures(tmp_path / "figures", train=7)
    with pytest.raises(InputError, match=r"differing: data \("):
        train_vae(small(), other, vae_run, CONTEXT)


def test_features_that_are_not_normalized_are_refused(tmp_path: Path) -> None:
    folder = write_moving_figures(tmp_path / "figures")
    manifest = read_manifest(folder)
    width = len(manifest.normalizer.mean)
    plain = replace(manifest.normalizer, mean=(0.0,) * width, std=(1.0,) * width)
    write_json(folder / "manifest.json", replace(manifest, normalizer=plain))
    with pytest.raises(InputError, match="normalized ones are near 1"):
        train_vae(small(), folder, tmp_path / "run", CONTEXT)


def test_a_second_stage_needs_a_trained_vae(figures: Path, vae_run: Path, tmp_path: Path) -> None:
    def start(vae: Path) -> None:
        train_denoiser(small(), figures, vae, LetterCount(), tmp_path / "run", CONTEXT)

    with pytest.raises(ModelError, match="no trained model"):
        start(tmp_path)
    unfinished = tmp_path / "unfinished"
    unfinished.mkdir()
    (unfinished / "experiment.json").write_bytes((vae_run / "experiment.json").read_bytes())
    with pytest.raises(ModelError, match="has not ended"):
        start(unfinished)


def test_widths_are_those_of_the_vae_and_the_text_encoder(
    figures: Path, vae_run: Path, tmp_path: Path
) -> None:
    widths = {"denoiser.latent_width": 5, "denoiser.condition_width": 9}
    experiment = small(**widths, **{"denoiser_training.steps": 1})
    folder = train_denoiser(experiment, figures, vae_run, LetterCount(), tmp_path / "run", CONTEXT)
    denoiser = load_model(folder).card.trained_denoiser
    assert (denoiser.latent_width, denoiser.condition_width) == (4, 6)


def test_parts_that_do_not_fit_are_named(figures: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"vae.features=263"):
        train_vae(small(**{"vae.features": 251}), figures, tmp_path / "run", CONTEXT)


def test_presets_come_back_from_json(tmp_path: Path) -> None:
    for name in PRESETS:
        write_json(tmp_path / name, preset_named(name))
        assert read_json(Experiment, tmp_path / name) == preset_named(name)


def test_unknown_names_are_answered_with_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean 'starter'"):
        preset_named("startr")
    for change, message in {
        "vae_trainin.steps=3": "did you mean 'vae_training'",
        "vae_training.step=3": "did you mean 'steps'",
        "vae_training.steps=many": "expected int, found 'many'",
        "name.x=3": "has no 'x'",
        "name": "expected KEY=VALUE",
    }.items():
        with pytest.raises(InputError, match=message):
            with_changes(preset_named("starter"), [change])


def test_the_papers_preset_has_the_papers_networks() -> None:
    experiment = preset_named("mld_humanml3d")
    count = sum(p.numel() for p in build(experiment.vae).parameters())
    assert count > 10_000_000
    assert experiment.denoiser.transformer.layers == 9


def test_a_model_to_start_from_that_does_not_exist_is_named(
    figures: Path, vae_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"train denoiser --data {figures} --vae {vae_run} -o {tmp_path / 'run'} --start nothing"
    with pytest.raises(SystemExit):
        main([*words.split(), "--set", "task=unconditional"])
    assert "no model 'nothing'" in capsys.readouterr().err


def test_a_finished_run_goes_on_with_more_steps(figures: Path, tmp_path: Path) -> None:
    def run(steps: int, **others: object) -> int:
        train_vae(small(**{"vae_training.steps": steps, **others}), figures, tmp_path, CONTEXT)
        return read_journal(tmp_path)[-1]["step"]

    assert run(4) == 4
    first = weights(tmp_path)
    assert run(6) == 6
    assert weights(tmp_path) != first
    assert len([line for line in read_journal(tmp_path) if line["kind"] == "train"]) == 6
    with pytest.raises(InputError, match=r"vae_training\.steps \(6 → 5\)"):
        run(5)
    with pytest.raises(InputError, match=r"differing: experiment\.vae_training\.seed"):
        run(8, **{"vae_training.seed": 3})


def test_packaged_models_are_vae_and_start_by_name_with_their_layers(
    figures: Path, tmp_path: Path
) -> None:
    words = f"train denoiser --data {figures} --vae starter --start starter -o {tmp_path}"
    quick = "--steps 1 --batch-size 2 --sample-every 0 --warm-up 1000 --set latents.per_item=1"
    main([*words.split(), *quick.split(), "--preset", "fast"])
    before, after = load_model(find_model("starter")), load_model(tmp_path / "model")
    assert after.card.denoiser == before.card.denoiser
    assert (after.card.latents, after.card.vae) == (before.card.latents, before.card.vae)
    pairs = zip(before.denoiser.parameters(), after.denoiser.parameters(), strict=True)
    assert all(torch.allclose(one, other, atol=1e-4) for one, other in pairs)


def test_who_starts_from_a_distilled_model_is_told_of_its_teacher() -> None:
    with pytest.raises(ModelError, match="distilled to few steps; start from its teacher"):
        with_networks_of(find_model("fast"), preset_named("starter"))


@pytest.mark.parametrize("ending", ["json", "toml"])
def test_presets_can_be_files(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"mine.{ending}"
    if ending == "json":
        settings = {"preset": "fast", "name": "mine", "vae_training": {"steps": 7}}
        path.write_text(json.dumps(settings))
    else:
        path.write_text('preset = "fast"\nname = "mine"\n[vae_training]\nsteps = 7\n')
    fast = preset_named("fast")
    expected = replace(fast, name="mine", vae_training=replace(fast.vae_training, steps=7))
    assert preset_named(str(path)) == expected


def test_run_folders_are_presets(vae_run: Path) -> None:
    assert preset_named(str(vae_run / "experiment.json")) == small()


def test_files_of_settings_that_do_not_fit_are_told(tmp_path: Path) -> None:
    for name, text, message in [
        ("a.json", '{"vae_training": {"step": 3}}', "did you mean 'steps'"),
        ("b.toml", "steps = ", "b.toml: "),
        ("c.json", "[3]", "expected an object of settings"),
        ("d.json", '{"preset": "startr"}', "did you mean 'starter'"),
    ]:
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=message):
            preset_named(str(tmp_path / name))
    with pytest.raises(InputError, match="nothing"):
        preset_named(str(tmp_path / "nothing.json"))


@pytest.mark.parametrize(("flags", "halved"), [({"avx512_bf16"}, True), ({"avx2"}, False)])
def test_bfloat16_is_chosen_where_the_processor_multiplies_it(
    monkeypatch: pytest.MonkeyPatch, flags: set[str], halved: bool
) -> None:
    monkeypatch.setattr(device, "processor_flags", lambda: flags)
    device.has_bfloat16.cache_clear()
    products = {}
    for precision in ("auto", "float32", "bfloat16"):
        with device.autocast(torch.device("cpu"), precision):
            products[precision] = (torch.ones(2, 2) @ torch.ones(2, 2)).dtype
    device.has_bfloat16.cache_clear()
    auto = torch.bfloat16 if halved else torch.float32
    assert products == {"auto": auto, "float32": torch.float32, "bfloat16": torch.bfloat16}


@pytest.mark.parametrize("version", [1, 3])
def test_a_run_of_another_version_is_refused(vae_run: Path, tmp_path: Path, version: int) -> None:
    data = json.loads((vae_run / "experiment.json").read_text())
    (tmp_path / "experiment.json").write_text(json.dumps(data | {"format": version}))
    with pytest.raises(InputError, match=f"format {version}, expected 2; update latentmotion"):
        read_run(tmp_path)
