"""One action in a window cut around it: what typed prompts ask for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SingleAction:
    """One action of a clip and the window that shows nothing else.

    Attributes:
        kind: What is done, such as `walk`, `punch` or `turn_then_walk`.
        start: First frame of the window (20 frames per second).
        end: The frame after the last one of the window.
        side: `left`, `right`, `both`, or nothing where no side applies.
        direction: `forward`, `backward`, `left`, `right`, `up`, `down`, or nothing.
        count: How often it is done; 1 where it is not counted.
        degrees: Net change of heading over the window, in degrees; 0 where none.
        gait: `walk`, `jog` or `run` while turning or circling; nothing on the spot.
        pace: `slow`, `normal` or `fast` for gaits; nothing where no pace applies.
        act: First frame and the frame after the last one of the act itself.
    """

    kind: str
    start: int
    end: int
    side: str = ""
    direction: str = ""
    count: int = 1
    degrees: float = 0.0
    gait: str = ""
    pace: str = ""
    act: tuple[int, int] = (0, 0)

    @property
    def frames(self) -> int:
        """Length of the window."""
        return self.end - self.start
