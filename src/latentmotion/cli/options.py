"""Types of the options that several verbs share: one name, one short form and one help text each.

A field of such a type needs no docstring, unless the type leaves the help text to the verb.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from tyro.conf import Positional, UseAppendAction, arg

from latentmotion import formats
from latentmotion.diffusion.samplers import SamplerName
from latentmotion.engine.backend import ExecutionOptions, Launch, Precision
from latentmotion.errors import InputError
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.kinematics.standing import METERS_PER_UNIT, NOTHING, Stated
from latentmotion.motion import Motion
from latentmotion.storage.files import check_writable

if TYPE_CHECKING:
    from latentmotion.storage.shards import ShardSubset

# Help text of one file of motions to read.
MOTION_FILE = f"Motion file: {' '.join(formats.READABLE)}."

Output = Annotated[Path, arg(aliases=["-o"])]  # File or folder to write; the verb says which.

# The same for verbs that can do without.
OptionalOutput = Annotated[Path | None, arg(aliases=["-o"])]

# Several files to write; the verb says in which formats.
Outputs = Annotated[tuple[Path, ...], arg(aliases=["-o"])]

PreparedOutput = Annotated[Path, arg(aliases=["-o"], help="Prepared folder to write.")]

# Folder to read; the verb documents its content.
Folder = Annotated[Positional[Path], arg(metavar="FOLDER")]

# File to read; the verb documents its content.
File = Annotated[Positional[Path], arg(metavar="FILE")]

# Several files to read; the verb documents their content.
Files = Annotated[Positional[tuple[Path, ...]], arg(metavar="FILES")]

Model = Annotated[
    Positional[str], arg(metavar="MODEL", help="Name, run folder or model folder of a model.")
]

_PREPARED = "Prepared folder, which `latentmotion data prepare` writes."
Data = Annotated[Path, arg(aliases=["-d"], help=_PREPARED)]
# Prepared folder, for verbs that can do without.
OptionalData = Annotated[Path | None, arg(aliases=["-d"])]

Evaluator = Annotated[
    Path | None,
    arg(
        aliases=["-e"],
        help="Folder of an evaluator, for FID, R-precision, accuracy and the like, or scorer for "
        "the scorer that ships; without one, "
        "only joints are compared.",
    ),
]

# Named here: the protocols' own module would load data sets for every command.
ProtocolChoice = Annotated[
    Literal["clean", "paper"],
    arg(help="Protocol: clean, or paper for that of the authors' code, quirk by quirk."),
]

Device = Annotated[
    str, arg(help="Where PyTorch computes: auto (a GPU if there is one), cpu, cuda or cuda:N.")
]
AUTO = "auto"  # The default of every `--device`.

# Engine of the networks; `auto` takes graphs if a folder has them, else PyTorch.
Runtime = Literal["auto", "onnxruntime", "openvino", "pytorch"]

RuntimeChoice = Annotated[
    Runtime,
    arg(
        help="What runs the networks: auto takes ONNX Runtime, or PyTorch for a model that was "
        "not exported."
    ),
]

Moves = Annotated[
    tuple[Path, ...], arg(help="Folders of `latentmotion teach` that motions may start from, too.")
]

Threads = Annotated[int | None, arg(help="Threads to use at most; by default one per core.")]

Seed = Annotated[int, arg(help="Seed of every random choice.")]

Steps = Annotated[int | None, arg(help="Sampling steps; by default the model's own.")]

Guidance = Annotated[
    float | None, arg(help="Guidance scale of the prompt; by default the model's own.")
]

_ENCODERS = (
    "a folder, the name of a model whose encoder is used, or minilm, clip, clip_hidden, "
    "distilbert, sentence_t5 or t5, from the hub or after a colon from a folder (clip:my/clip)"
)
TextEncoderName = Annotated[
    str, arg(help=f"Text encoder, for models that read sentences: {_ENCODERS}.")
]
TEXT_ENCODER = "starter"  # The text encoder that training takes by default.

OptionalTextEncoder = Annotated[
    str | None, arg(help=f"Text encoder in place of the model's own: {_ENCODERS}.")
]

Body = Annotated[
    Path | None,
    arg(
        help="SMPL model file (.npz, or .pkl of plain arrays), for models of SMPL's poses; "
        "without one, the skeleton that ships is used."
    ),
]

Goals = UseAppendAction[tuple[str, ...]]  # Goals of one kind, an option for each.

# Settings by `--set part.key=value`; the verb gives an example.
Changes = UseAppendAction[tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class SamplingOptions:
    """How a denoiser samples."""

    steps: Steps = None
    guidance: Guidance = None
    sampler: SamplerName | None = None
    """Sampler: ddim (Euler), heun (two passes a step), dpm++, or ddpm (fresh noise at every step);
    by default the model's own."""


@dataclass(frozen=True, kw_only=True)
class ComputingOptions:
    """What computes the networks, and how."""

    text_encoder: OptionalTextEncoder = None
    device: Device = AUTO
    precision: Precision = "float32"
    """Precision of PyTorch's matrix products and convolutions."""
    launch: Launch = "eager"
    """How PyTorch's work reaches the device: eager, graph (CUDA graphs) or compiled. The latter two
    take seconds before the first motion and pay off over hundreds."""

    @property
    def execution(self) -> ExecutionOptions:
        """Device, precision and launch mode of PyTorch."""
        return ExecutionOptions(self.device, self.precision, self.launch)


_UNIT = (
    f"Unit of length of the motion files: {' '.join(METERS_PER_UNIT)}, or a number, meters per "
    "unit; by default what the file says, else guessed by the legs."
)


@dataclass(frozen=True, kw_only=True)
class ReadingOptions:
    """Options of every command that reads motion files, with one meaning."""

    unit: Annotated[str | None, arg(help=_UNIT)] = None
    up: Literal["y", "-y", "z", "-z", "x", "-x"] | None = None
    """Axis that points up in the motion files; by default y, if the figure stands so."""
    fps: float | None = None
    """Frames per second of the motion files, if they state it wrongly or not at all."""
    map: tuple[Path, ...] = ()
    """JSON files, joint maps, that say which joints of an unknown skeleton are ours; each file is
    read by the first one that has joints of it."""

    def stated(self) -> Stated | None:
        """Returns what the user says about the files; None where that is nothing.

        Raises:
            FileFormatError: A joint map cannot be read.
            InputError: A number or a name is none.
        """
        maps = tuple(load_joint_map(path) for path in self.map)
        stated = Stated(self.unit, self.up, self.fps, maps)
        return None if stated == NOTHING else stated


@dataclass(frozen=True, kw_only=True)
class MotionOptions(ReadingOptions):
    """Options of every command that does something with the motions in files."""

    trim: tuple[float, float] | None = None
    """Take the part of each motion between two times, seconds."""
    speed: float = 1.0
    """Make motions so many times as fast."""
    mirror: bool = False
    """Swap left and right."""

    def load(self, path: Path) -> list[Motion]:
        """Reads the motions of a file, trimmed, sped up and mirrored as is asked for.

        Raises:
            DataError: The names of its joints are unknown, or its size or pose is nobody's.
            InputError: The file cannot be read, or a time or a number is out of range.
        """
        motions = formats.load(path, self.stated())
        try:
            if self.trim is not None:
                motions = [motion.cut(*self.trim) for motion in motions]
            if self.speed != 1:
                motions = [motion.at_speed(self.speed) for motion in motions]
            return [motion.mirrored() for motion in motions] if self.mirror else motions
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


DraftMapFile = Annotated[
    Path | None,
    arg(help="Write a guess of a joint map here, and nothing else; correct it, pass it by --map."),
]

PrintJson = Annotated[bool, arg(help="Print one JSON object instead of text.")]


def share_of(shard: str | None) -> ShardSubset:
    """Returns the part of some work that `--shard` names; all of it without.

    Raises:
        InputError: There is no such part.
    """
    from latentmotion.storage.shards import ShardSubset

    return ShardSubset.parse(shard) if shard else ShardSubset()


def values_for(kind: Any, command: Any) -> dict[str, Any]:
    """Returns the options of a command that are fields of another dataclass, too."""
    names = {field.name for field in fields(kind)} & {field.name for field in fields(command)}
    return {name: getattr(command, name) for name in names}


def check_outputs(paths: Iterable[Path]) -> None:
    """Checks that motions can be written to files, before work begins.

    Raises:
        InputError: An ending is unknown, or a folder cannot be written.
        LatentMotionError: A format needs what is not installed.
    """
    for path in paths:
        formats.check_ending(path)
        check_writable(path)


def save(paths: Iterable[Path], motions: Sequence[Motion]) -> None:
    """Writes motions to each of some files, and prints the names of what was written."""
    print_written([file for path in paths for file in formats.save(path, motions)])


def print_written(files: Iterable[Path]) -> None:
    """Prints the names of files that were written."""
    print("\n".join(f"wrote {path}" for path in files))


def refuse_unused(command: Any, reason: str, *names: str) -> None:
    """Refuses options that would have no effect, rather than ignore them.

    Args:
        command: A command, or a group of its options.
        reason: Why they would have none, e.g. "--prior decodes random latents".
        names: Names of the fields that would have none.

    Raises:
        InputError: One of them differs from its default.
    """
    unused, kinds = [], get_type_hints(type(command), include_extras=True)
    for field in fields(command):
        default = field.default
        if default is MISSING and field.default_factory is not MISSING:
            default = field.default_factory()
        value = getattr(command, field.name)
        if field.name in names and value != default:
            off = "no-" if value is False else ""
            words = f"--{off}{field.name.replace('_', '-')}"
            markers = getattr(kinds[field.name], "__metadata__", ())
            unused.append(field.name.upper() if Positional in markers else words)
    if unused:
        *first, last = unused
        listed = f"{', '.join(first)} and {last}" if first else last
        have, them = ("have", "them") if first else ("has", "it")
        raise InputError(f"{reason}, so {listed} {have} no effect; leave {them} out")
