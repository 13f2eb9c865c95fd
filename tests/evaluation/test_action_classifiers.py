"""Action classifiers: the authors' GRU and ACTOR's graph network by number, our own by law."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion.cli.main import main
from latentmotion.data.clip import Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import StoredMotion, read_manifest, stored_normalizer, write_dataset
from latentmotion.errors import DataError, InputError, ModelError
from latentmotion.evaluation.evaluators.action import (
    SMPL_PARENTS,
    ActionClassifier,
    GraphNetwork,
    GraphNetworkConfig,
    MotionGRUConfig,
    Recognizer,
    TemporalClassifierConfig,
    neighborhoods,
    recognizer_of,
    rotations_of,
    save_action_classifier,
)
from latentmotion.evaluation.evaluators.interface import ActionEvaluator, load_evaluator
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.interface import Normalizer
from latentmotion.storage.configuration import write_json
from latentmotion.training.classifier import (
    BEST,
    ClassifierExperiment,
    labelled,
    labels_of,
    train_classifier,
)
from latentmotion.training.experiment import TrainingSettings
from tests.support.golden import formula, golden_input, relative
from tests.support.moving_figures import motion
from tests.support.small_training import CONTEXT, killed_at

SMALL = TemporalClassifierConfig(features=5, labels=3, channels=8, dilations=(1, 3), width=4)


def random_network(config):
    torch.manual_seed(0)
    network = config.build().eval()
    for name, buffer in network.named_buffers():
        if name.endswith("running_mean"):
            buffer.uniform_(-0.3, 0.3)
        elif name.endswith("running_var"):
            buffer.uniform_(0.5, 2)
    for parameter in network.parameters():
        parameter.data.add_(0.05 * torch.randn_like(parameter))
    return network


def plain(features: np.ndarray) -> np.ndarray:
    return features


# The authors' GRU


def test_gru_has_the_authors_numbers(shared: Path) -> None:
    golden = np.load(shared / "reference" / "mld_outputs.npz")
    network = MotionGRUConfig().build().eval()
    weights = {
        key: torch.from_numpy(formula(f"model.{key}", tuple(value.shape)))
        for key, value in network.state_dict().items()
    }
    network.load_state_dict(weights)
    motions = golden_input("gru_motion", (5, 24, 3, 60)).permute(0, 3, 1, 2)
    features = network.features(motions, golden_input("gru_hidden", (2, 5, 128)))
    assert relative(features, golden["gru_features"]) < 1e-5
    assert relative(network.classify(features), golden["gru_logits"]) < 1e-5


def test_the_official_gru_becomes_an_evaluator(
    shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (file,) = (shared / "data" / "humanact12_classifier").iterdir()
    main(["convert", "evaluator", str(file), "-o", str(tmp_path / "gru")])
    assert "MotionGRU, 12 actions" in capsys.readouterr().out
    recognizer = load_evaluator(tmp_path / "gru")
    assert isinstance(recognizer, ActionEvaluator) and isinstance(recognizer, Recognizer)
    assert recognizer.labels[:3] == ("warm_up", "walk", "run")
    official = torch.load(file, map_location="cpu", weights_only=True)["model"]
    assert torch.equal(recognizer.network.state_dict()["linear1.bias"], official["linear1.bias"])


def test_only_the_paper_way_draws_the_first_state() -> None:
    network = random_network(MotionGRUConfig(joints=2, labels=3, hidden=8))
    recognizer = Recognizer(("a", "b", "c"), "", network, lambda x: x.reshape(-1, 2, 3), 6)
    motions = [np.random.default_rng(0).standard_normal((7, 6)).astype(np.float32)]
    clean = recognizer(motions).logits
    assert np.array_equal(clean, recognizer(motions).logits)
    drawn = [
        replace(recognizer, noise=np.random.default_rng(seed))(motions).logits for seed in (1, 1, 2)
    ]
    assert np.array_equal(drawn[0], drawn[1])
    assert not np.allclose(drawn[0], drawn[2]) and not np.allclose(drawn[0], clean)


def test_the_gru_sees_joints_in_the_axes_of_the_camera(tmp_path: Path) -> None:
    config = MotionGRUConfig(labels=2)
    about = ActionClassifier(("a", "b"), "smpl", config)
    save_action_classifier(tmp_path / "gru", about, config.build().state_dict())
    found = load_evaluator(tmp_path / "gru")
    features = np.zeros((5, 6, 25), np.float32)
    features[:, 0] = features[:, 4] = 1  # no joint turns
    features[:, :3, 24] = np.arange(5)[:, None]  # the way of the root
    assert isinstance(found, Recognizer)
    joints = found.prepare(features.reshape(5, 150))
    assert joints.shape == (5, 24, 3)
    assert np.allclose(joints[:, 0], np.arange(5)[:, None])
    assert found([features.reshape(5, 150)]).logits.shape == (1, 2)


# ACTOR's graph network


def dense_block(block, x: np.ndarray, adjacency: np.ndarray) -> np.ndarray:
    """One block by plain loops over frames and joints; x is (frames, joints, channels)."""
    numbers = {key: value.double().numpy() for key, value in block.state_dict().items()}

    def norm(y: np.ndarray, name: str) -> np.ndarray:
        scale = numbers[f"{name}.weight"] / np.sqrt(numbers[f"{name}.running_var"] + 1e-5)
        return (y - numbers[f"{name}.running_mean"]) * scale + numbers[f"{name}.bias"]

    frames, joints, _ = x.shape
    kernel = numbers["tcn.2.weight"][..., 0]
    outputs, reach = len(kernel), kernel.shape[2] // 2
    stride = block.tcn[2].stride[0]
    graph = np.zeros((frames, joints, outputs))
    for k, part in enumerate(adjacency):
        rows = slice(k * outputs, (k + 1) * outputs)
        weight, bias = numbers["gcn.conv.weight"][rows, :, 0, 0], numbers["gcn.conv.bias"][rows]
        for w in range(joints):
            for v in range(joints):
                graph[:, w] += part[v, w] * (x[:, v] @ weight.T + bias)
    graph = np.maximum(norm(graph, "tcn.0"), 0)
    steps = range(0, frames, stride)
    out = np.tile(numbers["tcn.2.bias"], (len(steps), joints, 1))
    for row, t in enumerate(steps):
        for offset in range(-reach, reach + 1):
            if 0 <= t + offset < frames:
                out[row] += graph[t + offset] @ kernel[:, :, offset + reach].T
    out = norm(out, "tcn.3")
    if "residual.0.weight" in numbers:
        weight, bias = numbers["residual.0.weight"][:, :, 0, 0], numbers["residual.0.bias"]
        out += norm(x[::stride] @ weight.T + bias, "residual.1")
    elif block.residual is not None:
        out += x
    return np.maximum(out, 0)


def test_graph_network_is_its_dense_formulation() -> None:
    network = random_network(GraphNetworkConfig(labels=4, widths=(6, 6, 8, 8)))
    motions = np.random.default_rng(0).standard_normal((2, 11, 24, 6))
    numbers = {key: value.double().numpy() for key, value in network.state_dict().items()}
    expected = []
    for x in motions:
        flat = x.reshape(11, -1) - numbers["data_bn.running_mean"]
        flat = flat / np.sqrt(numbers["data_bn.running_var"] + 1e-5) * numbers["data_bn.weight"]
        x = (flat + numbers["data_bn.bias"]).reshape(x.shape)
        for n, block in enumerate(network.st_gcn_networks):
            x = dense_block(block, x, numbers["A"] * numbers[f"edge_importance.{n}"])
        expected.append(x.mean(axis=(0, 1)))
    features = network.features(torch.from_numpy(motions).float())
    assert relative(features, np.array(expected)) < 1e-5
    logits = np.array(expected) @ numbers["fcn.weight"][:, :, 0, 0].T + numbers["fcn.bias"]
    assert relative(network.classify(features), logits) < 1e-5


def test_neighborhoods_share_out_every_joint_once() -> None:
    parts = neighborhoods(SMPL_PARENTS)
    assert np.allclose(parts.sum(axis=(0, 1)), 1)
    assert (np.count_nonzero(parts, axis=0) <= 1).all()
    # The root is nearer than the left hip, which has three bones: to the root, the knee, itself.
    assert parts[2][0, 1] == pytest.approx(1 / 3) and parts[1][4, 1] == pytest.approx(1 / 3)
    # The quirk: an ankle's parent, two bones from the root, is not known to be nearer to it.
    assert parts[1][4, 7] > 0 and parts[2][4, 7] == 0


def test_graph_network_has_the_sizes_and_names_of_actors_file() -> None:
    state = GraphNetworkConfig().build().state_dict()
    shapes = {key: tuple(value.shape) for key, value in state.items()}
    assert shapes["A"] == shapes["edge_importance.9"] == (3, 24, 24)
    assert shapes["data_bn.weight"] == (144,) and shapes["fcn.weight"] == (40, 256, 1, 1)
    assert shapes["st_gcn_networks.4.gcn.conv.weight"] == (384, 64, 1, 1)
    assert shapes["st_gcn_networks.7.tcn.2.weight"] == (256, 256, 9, 1)
    residuals = {key.split(".")[1] for key in shapes if ".residual." in key}
    assert residuals == {"4", "7"}


def test_a_file_like_actors_becomes_an_evaluator(tmp_path: Path) -> None:
    network = random_network(GraphNetworkConfig(labels=40))
    torch.save(network.state_dict(), tmp_path / "uestc_rot6d_stgcn.tar")
    names = tmp_path / "action_classes.txt"
    names.write_text("\n".join(f"action {n}" for n in range(40)))
    words = ["convert", "evaluator", str(tmp_path / "uestc_rot6d_stgcn.tar")]
    main([*words, "-o", str(tmp_path / "stgcn"), "--labels", str(names)])
    recognizer = load_evaluator(tmp_path / "stgcn")
    assert isinstance(recognizer, Recognizer) and recognizer.labels[39] == "action 39"
    motions = np.random.default_rng(0).standard_normal((2, 20, 150)).astype(np.float32)
    seen = torch.from_numpy(np.stack([rotations_of(m) for m in motions]))
    assert isinstance(recognizer.network, GraphNetwork)
    expected = network.features(seen).detach().numpy()
    assert np.allclose(recognizer(list(motions)).features, expected, atol=1e-5)


def test_rotations_leave_out_the_translation() -> None:
    by_joint = np.arange(25 * 6).reshape(25, 6)
    features = by_joint.T.reshape(1, 150)  # index = channel · 25 + joint
    assert np.array_equal(rotations_of(features)[0], by_joint[:24])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"weights": torch.zeros(3)}, "lacks text_encoder"),
        ({"model": {"recurrent.weight_ih_l0": torch.zeros(6, 6)}}, "a weight is missing"),
    ],
)
def test_other_files_are_refused(
    content: object, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torch.save(content, tmp_path / "file.tar")
    with pytest.raises(SystemExit):
        main(["convert", "evaluator", str(tmp_path / "file.tar"), "-o", str(tmp_path / "out")])
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# Our own


def recognizer() -> Recognizer:
    return Recognizer(("a", "b", "c"), "", random_network(SMALL), plain, 5)


def test_each_motion_is_judged_as_if_alone() -> None:
    generator = np.random.default_rng(0)
    lengths = (9, 3, 9, 1, 20)
    motions = [generator.standard_normal((n, 5)).astype(np.float32) for n in lengths]
    together = recognizer()(motions)
    for row, alone in enumerate(motions):
        assert np.allclose(recognizer()([alone]).logits[0], together.logits[row], atol=1e-6)
    assert together.features.shape == (5, 4)


def test_padding_does_not_leak() -> None:
    network = random_network(SMALL)
    motion = torch.randn(1, 6, 5)
    padded = torch.cat([motion, 9 * torch.ones(1, 4, 5)], dim=1)
    mask = torch.arange(10)[None] < 6
    assert torch.allclose(network.features(motion), network.features(padded, mask), atol=1e-6)


def test_other_features_are_refused() -> None:
    with pytest.raises(InputError, match="with 5 features"):
        recognizer()([np.zeros((4, 6), np.float32)])
    with pytest.raises(InputError, match="no motion"):
        recognizer()([])


def test_a_folder_is_read_back(tmp_path: Path) -> None:
    config = replace(SMALL, features=263)
    about = ActionClassifier(("a", "b", "c"), "humanml3d", config, (0.5,) * 263, (2.0,) * 263)
    network = random_network(config)
    save_action_classifier(tmp_path / "judge", about, network.state_dict())
    found = load_evaluator(tmp_path / "judge")
    assert isinstance(found, Recognizer) and len(found.fingerprint) == 64
    motions = [np.random.default_rng(0).standard_normal((8, 263)).astype(np.float32)]
    expected = recognizer_of(about, network, "")(motions).logits
    assert np.array_equal(found(motions).logits, expected)
    (tmp_path / "judge" / "weights.safetensors").write_bytes(b"nothing")
    with pytest.raises(ModelError, match="damaged"):
        load_evaluator(tmp_path / "judge")


def test_labels_and_network_must_agree(tmp_path: Path) -> None:
    about = ActionClassifier(("a", "b"), "humanml3d", SMALL)
    save_action_classifier(tmp_path / "judge", about, SMALL.build().state_dict())
    with pytest.raises(ModelError, match="2 labels for a network of 3"):
        load_evaluator(tmp_path / "judge")


# Actions of the synthetic data, and those of their mirror images.
LABELS = {"kick left": "kick right", "sway": "sway"}


@pytest.fixture(scope="module")
def actions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two kinds of figures, one of which is a meter off in every position."""
    folder = tmp_path_factory.mktemp("data") / "actions"
    generator, motions = np.random.default_rng(0), []
    for number in range(18):
        split = "train" if number < 12 else "val" if number < 15 else "test"
        stored, label = motion(generator, number, split), list(LABELS)[number % 2]
        clip = replace(stored.clip, action=label, mirrored_action=LABELS[label])
        features = stored.features.copy()
        features[:, 3:67] += number % 2
        motions.append(StoredMotion(clip, features))
    fitted = Normalizer.fit([m.features for m in motions], HUMANML3D_FEATURES.blocks)
    source = Source("synthetic", "CC0-1.0", "nobody")
    stored = stored_normalizer(fitted, "these clips")
    write_dataset(folder, motions, (source,), HUMANML3D_FEATURES, stored)
    return folder


def small_experiment(mirrored_classes: bool = False) -> ClassifierExperiment:
    training = TrainingSettings(
        steps=20,
        batch_size=8,
        learning_rate=0.01,
        warm_up=3,
        ema_decay=0.5,
        validate_every=5,
        snapshot_every=5,
        sample_every=0,
    )
    network = TemporalClassifierConfig(channels=8, dilations=(1,), width=4, dropout=0.0)
    return ClassifierExperiment(network, mirrored_classes, training=training)


def test_mirrored_copies_count_where_their_labels_do(actions: Path) -> None:
    dataset = Dataset.load(actions)
    assert labels_of(dataset, False) == ("kick left", "sway")
    assert labels_of(dataset, True) == ("kick left", "kick right", "sway")
    found = labelled(dataset, "val", ("kick left", "sway"))
    assert sum(clip.mirrored for clip in found) == sum(clip.action == "sway" for clip in found) / 2


def test_a_classifier_learns_and_goes_on_bit_for_bit(actions: Path, tmp_path: Path) -> None:
    whole = train_classifier(small_experiment(), actions, tmp_path / "whole", CONTEXT)
    with killed_at(13):
        train_classifier(small_experiment(), actions, tmp_path / "parts", CONTEXT)
    assert (tmp_path / "parts" / BEST).exists()
    parts = train_classifier(small_experiment(), actions, tmp_path / "parts", CONTEXT)
    weights = [(folder / "weights.safetensors").read_bytes() for folder in (whole, parts)]
    assert weights[0] == weights[1]
    found = load_evaluator(whole)
    assert isinstance(found, Recognizer) and found.labels == ("kick left", "sway")
    dataset = Dataset.load(actions)
    tests = dataset.clips("test")
    logits = found([dataset.features(clip) for clip in tests]).logits
    assert [found.labels[row] for row in logits.argmax(1)] == [clip.action for clip in tests]


def test_another_run_and_data_without_labels_are_refused(actions: Path, tmp_path: Path) -> None:
    unlabelled = shutil.copytree(actions, tmp_path / "unlabelled")
    manifest = read_manifest(actions)
    clips = tuple(replace(c, action=None, mirrored_action=None) for c in manifest.clips)
    write_json(unlabelled / "manifest.json", replace(manifest, clips=clips))
    with pytest.raises(DataError, match="has 0 action labels"):
        train_classifier(small_experiment(), unlabelled, tmp_path / "run", CONTEXT)
    short = replace(small_experiment(), training=TrainingSettings(steps=1, sample_every=0))
    train_classifier(short, actions, tmp_path / "run", CONTEXT)
    with pytest.raises(InputError, match="mirrored_classes"):
        train_classifier(replace(short, mirrored_classes=True), actions, tmp_path / "run", CONTEXT)
