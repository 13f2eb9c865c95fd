"""Limits of files: they come from anywhere, and none may cost more than these.

Sizes, counts, rates and references are compared with them before memory is taken.
"""

from __future__ import annotations

# Bytes that a packed byte may become. Motion shrinks to a tenth at best; padded poses and captions
# that repeat to a fortieth. Only made files shrink to a thousandth.
UNPACKED_FACTOR = 50

# Bytes that any packed file may become, however small: an array of zeros shrinks to nothing.
UNPACKED_FREE = 1 << 26

# Bytes that a packed file may become at most: what a computer for work has.
MOST_UNPACKED = 1 << 32

XZ_MEMORY = 1 << 27  # Bytes that unpacking xz may take for itself: its highest preset needs half.

MOST_TEXT = 1 << 30  # Bytes of a text file: a BVH of ten hours is smaller.

# Bytes of JSON: the largest manifests have a tenth. Python needs ten times as much for it.
MOST_JSON = 1 << 28

# Levels of brackets in JSON. Cards have ten; code that walks them recursively ends at some 500.
MOST_NESTING = 64

MOST_DIGITS = 19  # Digits of a whole number in JSON: 64 bits, as in NumPy.

MOST_JOINTS = 2048  # Joints of a skeleton. Faces and capes of games have some hundreds.

# Letters of all names of a skeleton together; names are compared with each convention's.
MOST_NAMES = 1_000_000

# Characters of the address of a file that another one names; no system has longer paths.
MOST_ADDRESS = 4096

# Joints from the root to a tip: writers of nested formats walk the tree recursively.
MOST_DEPTH = 256

MOST_NODES = 100_000  # Nodes of a glTF scene, bones or not.

# Frames to which keys far apart are filled in at most: nearly two hours at 30 fps.
MOST_FRAMES = 200_000

# Frames times joints that a file need not state in numbers: 4 GB with all that is computed from
# them; an hour of 37 joints at 30 fps whose keys lie far apart.
MOST_FILLED = 4_000_000

# Frames times joints for each number that a file states: joints may rest while others move.
FILLED_FACTOR = 16

# Frames per second of a file: time-lapse, and high-speed cameras.
LEAST_FPS, MOST_FPS = 0.01, 10_000.0

FARTHEST = 1e6  # Meters from the origin, or of a bone: here float32 counts in steps of 6 cm.

# Size of any number of a motion file, in any unit: products of some of them stay finite.
MOST_NUMBER = 1e12

# Numbers per token, or inside a layer. The largest text encoders have a sixteenth.
MOST_WIDTH = 65_536

MOST_LAYERS = 256  # Layers of a network.

MOST_STEPS = 100_000  # Sampling steps, or discrete times of a schedule. The usual number is 1,000.

MOST_GOALS = 64  # Goals of a kind of one motion, or points of its path.

MOST_SPANS = 16  # Prompts of a timeline, or of the parts of the body during it.

MOST_TOKENS = 200_000  # Latent tokens, or frames, of one generated motion.

# Bytes that all graphs of a process may take together on ONNX Runtime, with weights; large text
# encoders have half.
GRAPH_MEMORY = 1 << 33

# Bytes of address space of the process that reads USD: its libraries take 1 GB of them.
USD_MEMORY = 1 << 32

USD_SECONDS = 120  # Seconds of processor time of the process that reads USD.

# Age from which a temporary file of another machine is taken for one that was left behind.
STALE_SECONDS = 86_400

MOST_PROMPTS = 20_000_000  # Rows of a file of prompts: some 5 GB of memory.

# Characters of a prompt in a file of prompts; text encoders read some hundred words at most.
MOST_PROMPT = 2000
