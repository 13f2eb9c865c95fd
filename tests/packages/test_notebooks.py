"""Tools of notebooks and data: each example, read back by the tool itself."""

from __future__ import annotations

import importlib
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from huggingface_hub import ModelCard

from latentmotion import Dataset
from latentmotion.export.package import readme
from latentmotion.model.card import read_card

ROOT = Path(__file__).parents[2]
SENTENCE = "a person waves"


def example(name: str, package: str, install: str = "") -> ModuleType:
    pytest.importorskip(package, reason=f"needs {package}: pip install {install or package}")
    return importlib.import_module(f"examples.{name}")


@pytest.mark.filterwarnings("ignore")  # of gradio's own event loop
def test_gradio_answers_its_own_client_with_a_character() -> None:
    gradio_app = example("gradio_app", "gradio")
    from gradio_client import Client

    page = gradio_app.app()
    _, url, _ = page.launch(prevent_thread_lock=True, quiet=True, server_name="127.0.0.1")
    try:
        answer = Client(url, verbose=False).predict(SENTENCE, 1, api_name="/glb")
        assert Path(answer).read_bytes().startswith(b"glTF")
    finally:
        page.close()


def test_rerun_reads_its_recording(tmp_path: Path) -> None:
    rerun_log = example("rerun_log", "rerun", "rerun-sdk")
    rerun_log.main(SENTENCE, str(tmp_path / "walk.rrd"))
    command = [sys.executable, "-m", "rerun", "rrd", "print", str(tmp_path / "walk.rrd")]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for name in ("person/bones", "person/joints", "height/pelvis"):
        assert name in told, name


def test_viser_serves_the_moving_figure() -> None:
    viser_view = example("viser_view", "viser")
    thread = threading.Thread(target=viser_view.main, args=(SENTENCE, "8791", "1"))
    thread.start()
    page = b""
    while thread.is_alive() and not page:
        try:
            with urllib.request.urlopen("http://127.0.0.1:8791", timeout=5) as answer:
                page = answer.read()
        except OSError:
            time.sleep(0.1)
    thread.join()
    assert b"<html" in page.lower()


def test_prepared_clips_become_a_dataset_and_parquet(figures: Path, tmp_path: Path) -> None:
    tables = example("tables", "datasets")
    import datasets

    pandas = pytest.importorskip("pandas", reason="needs pandas: pip install pandas")
    file = tmp_path / "clips.parquet"
    tables.main(str(figures), str(file), "train", "3")
    frame = pandas.read_parquet(file)
    assert list(frame) == ["clip", "captions", "fps", "joints"] and len(frame) == 3
    table = datasets.Dataset.from_parquet(str(file), cache_dir=str(tmp_path)).with_format("numpy")
    data = Dataset.load(figures)
    for row, clip in zip(table, data.clips("train"), strict=False):
        expected = data.representation.decode(data.features(clip))
        assert np.allclose(row["joints"], expected, atol=1e-5)


@pytest.mark.parametrize("name", ["fast", "starter"])
def test_the_hub_reads_the_pages_of_models(name: str) -> None:
    card = read_card(ROOT / "src/latentmotion/models" / name)
    page = ModelCard(readme(card))
    assert page.data.license == "cc-by-sa-3.0" and page.data.library_name == "latentmotion"
    assert page.data.pipeline_tag == "text-to-3d" and page.data.language == ["en"]
    results = page.data.eval_results
    assert results and all(np.isfinite(one.metric_value) for one in results)
    assert {one.dataset_type for one in results} == {"motion-capture"}
    assert ModelCard(str(page)).data.to_dict() == page.data.to_dict()
