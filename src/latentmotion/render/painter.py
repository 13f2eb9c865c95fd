"""Drawing a mannequin on a floor without a GPU: camera, floor, shadow, shaded body.

pixel = middle + focal · (right·p, −up·p) / (ahead·p),   p relative to the eye

The nearest face wins each pixel. Light there, with the normal n between its corners', towards the
eye v:

    color · (ambient · (1 + n_y)/2 + key · max(n·l, 0)) + rim · (1 − n·v)³

Everything is drawn at twice the size and reduced, which smooths the edges.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from latentmotion.arrays import unit
from latentmotion.errors import InputError, MissingExtraError
from latentmotion.kinematics.skeleton import Joints
from latentmotion.motion import Motion
from latentmotion.render.mannequin import Figure, mannequin_of

if TYPE_CHECKING:
    from PIL.Image import Image as Picture


# Meters of path below which a motion counts as in place.
_SHORT = 0.8


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole that looks at a point."""

    eye: Float[np.ndarray, " width"]  # Its position, meters.
    # The point it looks at, in the middle of the picture, meters.
    target: Float[np.ndarray, " width"]
    focal: float  # Pixels for one meter at one meter's distance.
    size: tuple[int, int]  # Width and height of the picture, pixels.

    def project(
        self, points: Float[np.ndarray, "*batch 3"]
    ) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch"]]:
        """Returns pixels (right, down) and distances along the line of sight."""
        right, up, ahead = self.axes()
        relative = points - self.eye
        depth = relative @ ahead
        scale = self.focal / np.maximum(depth, 0.1)
        middle = np.array(self.size) / 2
        flat = np.stack([relative @ right, -(relative @ up)], axis=-1)
        return middle + flat * scale[..., None], depth

    def axes(self) -> tuple[Float[np.ndarray, " width"], ...]:
        """Returns the unit vectors to the right, up and ahead."""
        ahead = unit(self.target - self.eye)
        right = unit(np.cross(ahead, np.array([0.0, 1.0, 0.0])))
        return right, np.cross(right, ahead), ahead


def camera_around(
    target: Float[np.ndarray, " width"],
    azimuth: float,
    elevation: float,
    distance: float,
    size: tuple[int, int],
    visible_height: float,
) -> Camera:
    """Places a camera on a sphere around a point.

    Args:
        target: Center of the sphere, meters.
        azimuth: Angle of the camera about the vertical, from +z towards +x, radians.
        elevation: Angle above the horizontal, radians.
        distance: Radius, meters; a large one looks almost without perspective.
        size: Width and height of the picture, pixels.
        visible_height: Meters at the target that fill the picture's height.
    """
    level = np.cos(elevation)
    toward = np.array([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level])
    return Camera(target + distance * toward, target, size[1] * distance / visible_height, size)


def camera_of_all(
    motion: Motion, vertices: Float[np.ndarray, "frames vertices 3"], size: tuple[int, int]
) -> tuple[Camera, float]:
    """Returns a camera that looks across the path, not from behind, and sees all figures.

    Args:
        motion: The motion, for its path.
        vertices: The points that must be seen, meters.
        size: Width and height of the picture, pixels.

    Returns:
        The camera, and the meters that fill the picture's height.
    """
    center = (vertices.min((0, 1)) + vertices.max((0, 1))) / 2
    # A person of 1.8 m with room above and below, which the loop then adapts to the motion.
    azimuth, height = half_front(motion), 2.2
    path = motion.joints[:, 0][:, [0, 2]].astype(np.float64)
    path = path - path.mean(0)
    if np.linalg.norm(np.ptp(path, axis=0)) >= _SHORT:
        x, z = np.linalg.svd(path, full_matrices=False)[2][0]
        side = float(np.arctan2(z, -x))
        # The main direction of the path runs across the picture, on the side that shows the front.
        azimuth = side if np.cos(side - azimuth) > 0 else side + np.pi
    camera = camera_around(center, azimuth, np.radians(16), 9, size, height)
    # The projection depends on the distance, and the distance on the projection: a fixed point,
    # reached to a pixel in fewer rounds than 12. Bodies fill 0.46 of the picture to either side.
    for _ in range(12):
        pixels, _ = camera.project(vertices)
        height *= float(np.abs(pixels / np.array(size) - 0.5).max()) / 0.46
        camera = camera_around(center, azimuth, np.radians(16), max(9, 2 * height), size, height)
    return camera, height


def half_front(motion: Motion) -> float:
    """Returns the azimuth that shows the person half from the front at the start."""
    left, right = (motion.skeleton.names.index(f"{side}_hip") for side in ("left", "right"))
    across = motion.joints[0, left] - motion.joints[0, right]
    # At 38 degrees neither arm hides behind the trunk, and steps are seen as they go forward.
    return float(np.arctan2(-across[2], across[0])) - np.radians(38)


try:
    from PIL import Image, ImageDraw, ImageFilter, ImageFont
except ImportError as error:
    raise MissingExtraError("drawing motions", "Pillow", "video") from error


OVERSAMPLING = 2  # Supersampling: factor by which a picture is drawn larger, in each direction.

BACKGROUND = (247, 248, 250)
INK = (58, 64, 76)
# One color for each take, as on the page.
COLORS = ((47, 143, 157), (226, 105, 74), (122, 104, 196), (217, 154, 43))

# Color of what has none of its take.
_BODY = (196, 201, 210)

# Pixels of faces that are drawn at once: a bound on memory.
_FRAGMENTS = 1 << 20

_GRID = (205, 211, 220)
_MESH = 0.5  # Meters between the lines of the grid.
_SHADOW = (176, 183, 196)
_SHADOW_REDUCTION = 4
# Direction of the light in the camera's axes: right, up, ahead.
_SUN = (-0.3, 1.0, -0.35)


@dataclass(frozen=True, eq=False)
class Bodies:
    """The skin of one person in every frame, ready to be drawn."""

    vertices: Float[np.ndarray, "frames vertices 3"]  # Positions, meters.
    normals: Float[np.ndarray, "frames vertices 3"]  # Outward normals.
    triangles: Int[np.ndarray, "triangles 3"]  # Corners of the faces.
    shell: int  # Number of faces, the first, that do not have the take's color.
    joints: Joints  # Positions of the joints.

    def moved(self, frame: int, shift: Float[np.ndarray, " width"]) -> Bodies:
        """Returns a single frame, displaced along the floor."""
        vertices = self.vertices[frame : frame + 1] + shift
        joints = self.joints[frame : frame + 1] + shift
        normals = self.normals[frame : frame + 1]
        return replace(self, vertices=vertices, normals=normals, joints=joints)

    @property
    def floor(self) -> float:
        """Height of the floor on which the lowest foot stands."""
        return float(np.percentile(self.joints[..., 1].min(-1), 10))


def make_bodies(
    motion: Motion, frames: Sequence[int] | None = None, figure: Figure = mannequin_of
) -> Bodies:
    """Returns the body of a motion, in some frames or in all.

    Raises:
        InputError: The joints are not named as a body's.
    """
    names = motion.skeleton.names
    if not {"left_hip", "right_hip"} <= {*names}:
        shown = ", ".join(names[:4])
        raise InputError(f"cannot draw joints {shown}, …; expected a body with left_hip, right_hip")
    mannequin, animation = figure(motion)
    chosen = np.arange(len(motion)) if frames is None else np.asarray(frames)
    picked = animation.picked(chosen)
    vertices, normals = mannequin.pose(picked)
    joints = picked.joints()[:, np.unique(mannequin.joints[mannequin.weights > 0])]
    if animation.skeleton.names == names:
        joints = motion.joints[chosen].astype(np.float64)
    return Bodies(vertices, normals, mannequin.triangles, mannequin.shell, joints)


def oversampled(size: tuple[int, int]) -> tuple[int, int]:
    """Returns the size at which a picture of final size is drawn."""
    return size[0] * OVERSAMPLING, size[1] * OVERSAMPLING


def painted(
    camera: Camera,
    bodies: Sequence[Bodies],
    frame: int,
    floor: float,
    reach: float,
    colors: Sequence[tuple[int, int, int]],
    strengths: Sequence[float] | None = None,
    trail: Float[np.ndarray, "frames 3"] | None = None,
) -> Picture:
    """Returns a picture of bodies on a floor, with smooth edges.

    Args:
        camera: Its picture is oversampled.
        bodies: The bodies.
        frame: Their frame.
        floor: Height of the floor, meters.
        reach: Meters around the camera's target up to which the floor is seen.
        colors: Color of each body's take.
        strengths: How much each body stands out, 0 to 1; by default fully.
        trail: A path that is drawn on the floor, meters.
    """
    picture = Image.new("RGB", camera.size, BACKGROUND)
    paint_floor(picture, camera, floor, reach)
    paint_shadow(picture, camera, bodies, frame, floor)
    if trail is not None:
        pixels, _ = camera.project(trail * (1, 0, 1) + (0, floor, 0))
        line = [tuple(pixel) for pixel in pixels.tolist()]
        ImageDraw.Draw(picture).line(line, fill=_SHADOW, width=3 * OVERSAMPLING, joint="curve")
    paint_bodies(picture, camera, bodies, frame, colors, strengths)
    return picture.reduce(OVERSAMPLING)


def paint_floor(picture: Picture, camera: Camera, height: float, reach: float) -> None:
    """Draws a grid on the floor around the camera's target that fades with the distance."""
    # Lines along x and z stay where they are when the target moves.
    across = np.arange(-np.ceil(reach / _MESH), np.ceil(reach / _MESH) + 1) * _MESH
    still, moving = np.meshgrid(across, np.linspace(-reach, reach, 17), indexing="ij")
    grids = []
    for axis in (0, 2):
        points = np.full((*still.shape, 3), height)
        points[..., axis] = still + np.round(camera.target[axis] / _MESH) * _MESH
        points[..., 2 - axis] = moving + camera.target[2 - axis]
        grids.append(points)
    lines = np.concatenate(grids)
    pixels, depth = camera.project(lines)
    away = np.linalg.norm((lines - camera.target)[..., [0, 2]], axis=-1) / reach
    strength = np.clip(1 - away**2, 0, 1)
    # Lines near the camera would project to infinity, and those below 2 % cannot be seen.
    visible = (np.minimum(depth[:, 1:], depth[:, :-1]) > 0.3) & (strength[:, 1:] > 0.02)
    ends = np.concatenate([pixels[:, :-1], pixels[:, 1:]], axis=-1)[visible].tolist()
    draw = ImageDraw.Draw(picture)
    for line, share in zip(ends, strength[:, 1:][visible].tolist(), strict=True):
        draw.line(line, fill=faded(_GRID, share), width=OVERSAMPLING)


def paint_shadow(
    picture: Picture, camera: Camera, bodies: Sequence[Bodies], frame: int, height: float
) -> None:
    """Darkens the floor in the shadow of bodies."""
    size = picture.width // _SHADOW_REDUCTION, picture.height // _SHADOW_REDUCTION
    mask = Image.new("L", size, 0)
    draw = ImageDraw.Draw(mask)
    right, _, ahead = camera.axes()
    sun = _SUN[0] * right + _SUN[2] * ahead
    sun[1] = _SUN[1]
    for body in bodies:
        vertices = body.vertices[frame]
        lit = body.triangles[(body.normals[frame][body.triangles].sum(1) @ sun) > 0]
        pixels, _ = camera.project(vertices - (vertices[:, 1:2] - height) * sun)
        for corners in (pixels[lit] / _SHADOW_REDUCTION).reshape(-1, 6).tolist():
            # Three quarters dark, so that the grid is still seen in the shadow.
            draw.polygon(corners, fill=190)
    # As soft as a lamp's edge at any size: 4 pixels of 512.
    mask = mask.filter(ImageFilter.GaussianBlur(max(1.0, size[1] / 130)))
    box = mask.getbbox()
    if box is not None:
        left, top, right, bottom = (n * _SHADOW_REDUCTION for n in box)
        soft = mask.crop(box).resize((right - left, bottom - top), Image.Resampling.BILINEAR)
        picture.paste(_SHADOW, (left, top, right, bottom), soft)


def paint_bodies(
    picture: Picture,
    camera: Camera,
    bodies: Sequence[Bodies],
    frame: int,
    colors: Sequence[tuple[int, int, int]],
    strengths: Sequence[float] | None = None,
) -> None:
    """Draws one frame of each body.

    Args:
        picture: Picture to paint on; the bodies hide its content.
        camera: Sees it.
        bodies: The bodies.
        frame: Number of the frame.
        colors: One for each body.
        strengths: Opacity of each, from the background's color, 0, to its own, 1.
    """
    right, up, ahead = camera.axes()
    # A key light from above, the left and behind the camera; `sky` lights what faces up, `rim` the
    # outline, `shine` is a highlight (Blinn-Phong).
    key = unit(0.6 * up - 0.45 * right - 0.65 * ahead)
    image = np.array(picture)
    flat, nearest = image.reshape(-1, 3), np.full(image.shape[0] * image.shape[1], np.inf)
    for body, color, strength in zip(bodies, colors, strengths or [1.0] * len(bodies), strict=True):
        pixels, depth = camera.project(body.vertices[frame])
        tints = np.array([faded(_BODY, strength), faded(color, strength)], dtype=np.float64)
        for fragment_pixels, faces, shares in _fragments(
            pixels, depth, body.triangles, picture.size, nearest
        ):
            corners = body.triangles[faces]
            normals = unit(np.einsum("fk,fkc->fc", shares, body.normals[frame][corners]))
            sky = 0.5 + 0.5 * normals[:, 1]
            lambert = np.maximum(normals @ key, 0)
            shine = np.maximum(normals @ unit(key - ahead), 0) ** 24
            rim = np.clip(1 + normals @ ahead, 0, 1) ** 3
            share = 0.36 + 0.32 * sky + 0.50 * lambert
            tint = tints[(faces >= body.shell).astype(int)]
            light = share[:, None] * tint + (strength * (26 * shine + 26 * rim * sky))[:, None]
            flat[fragment_pixels] = np.clip(light, 0, 255).astype(np.uint8)
    picture.paste(Image.fromarray(image))


def _fragments(
    pixels: Float[np.ndarray, "vertices 2"],
    depth: Float[np.ndarray, " vertices"],
    triangles: Int[np.ndarray, "triangles 3"],
    size: tuple[int, int],
    nearest: Float[np.ndarray, " pixels"],
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yields the pixels that faces win, the faces, and the shares of their corners there.

    Args:
        pixels: Corners of the faces in the picture.
        depth: Their distances.
        triangles: Corners of each face.
        size: Width and height of the picture.
        nearest: Distance of what each pixel shows so far; is changed.
    """
    corners = pixels[triangles]
    (ax, ay), (bx, by), (cx, cy) = np.moveaxis(corners, 0, -1)
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)  # negative in front: pixels go down
    low = np.clip(np.ceil(corners.min(1) - 0.5), 0, size).astype(int)
    high = np.clip(np.floor(corners.max(1) - 0.5) + 1, 0, size).astype(int)
    width, height = (high - low).clip(0).T
    sizes = width * height
    faces = np.flatnonzero((area < 0) & (sizes > 0) & (depth[triangles].min(1) > 0.1))
    parts = np.split(faces, np.flatnonzero(np.diff(np.cumsum(sizes[faces]) // _FRAGMENTS)) + 1)
    for part in parts if len(faces) else []:
        count = sizes[part]
        face = np.repeat(part, count)
        step = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
        x, y = low[face, 0] + step % width[face], low[face, 1] + step // width[face]
        px, py = x + 0.5, y + 0.5
        third = ((bx - ax)[face] * (py - ay[face]) - (by - ay)[face] * (px - ax[face])) / area[face]
        second = ((px - ax[face]) * (cy - ay)[face] - (py - ay[face]) * (cx - ax)[face]) / area[
            face
        ]
        shares = np.stack([1 - second - third, second, third], axis=-1)
        inside = (shares >= -1e-9).all(-1)
        face, shares = face[inside], shares[inside]
        indices = y[inside] * size[0] + x[inside]
        away = (shares * depth[triangles[face]]).sum(-1)
        np.minimum.at(nearest, indices, away)
        won = away <= nearest[indices]
        yield indices[won], face[won], shares[won]


def paint_text(
    picture: Picture,
    text: str,
    position: tuple[float, float],
    size: int,
    anchor: str,
    room: float = 1e9,
) -> None:
    """Writes one line on a picture of final size, shortened to `room` pixels."""
    font = font_for(text, size)
    draw = ImageDraw.Draw(picture)
    if draw.textlength(text, font=font) > room:
        while text and draw.textlength(text + "…", font=font) > room:
            text = text[:-1].rstrip()
        text += "…"
    draw.text(position, text, fill=INK, font=font, anchor=anchor)


# Fonts of Linux, macOS and Windows for letters that Pillow's own font lacks, by file.
_FONTS = (
    *("NotoSans-Regular.ttf", "DejaVuSans.ttf", "NotoSansCJK-Regular.ttc", "wqy-microhei.ttc"),
    *("Arial Unicode.ttf", "PingFang.ttc", "Hiragino Sans GB.ttc", "AppleSDGothicNeo.ttc"),
    *("msyh.ttc", "YuGothM.ttc", "malgun.ttf", "Nirmala.ttf", "arial.ttf"),
)


def font_for(text: str, size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Returns Pillow's font, or the font of this computer that has most of a text's letters."""
    best = ImageFont.load_default(size)
    fewest = _lacking(best, text)
    for name in _FONTS:
        if not fewest:
            break
        try:
            font = ImageFont.truetype(name, size)
        except OSError:  # there is none
            continue
        if (lacking := _lacking(font, text)) < fewest:
            best, fewest = font, lacking
    return best


def _lacking(font: ImageFont.FreeTypeFont | ImageFont.ImageFont, text: str) -> int:
    """Returns how many letters of a text a font draws as it draws what no font has."""

    def drawn(letter: str) -> bytes:
        mask: Any = font.getmask(letter)
        return bytes(mask)

    blank = drawn("\U0010ffff")
    return sum(drawn(letter) == blank for letter in set(text) if not letter.isspace())


def faded(color: tuple[int, int, int], strength: float) -> tuple[int, int, int]:
    """Returns a color blended from the background (0) to itself (1)."""
    red, green, blue = (
        round(x + (y - x) * strength) for x, y in zip(BACKGROUND, color, strict=True)
    )
    return red, green, blue
