"""A page with a prompt and the moving figure (pip install gradio).

python examples/gradio_app.py
"""

import sys
import tempfile

import gradio

from latentmotion import MotionPipeline


def app() -> gradio.Interface:
    """Returns the page."""
    generate, folder = MotionPipeline.from_pretrained(), tempfile.mkdtemp()

    def glb(prompt: str, seed: float) -> str:
        name = f"{folder}/{abs(hash((prompt, seed)))}.glb"
        return str(generate(prompt, seed=int(seed)).save(name)[0])

    inputs = [gradio.Textbox("a person walks and waves", label="Prompt"), gradio.Number(0)]
    return gradio.Interface(glb, inputs, gradio.Model3D(), flagging_mode="never")


def main() -> None:
    """Serves the page on this machine."""
    app().launch()


if __name__ == "__main__":
    main(*sys.argv[1:])
