"""Pictures and videos of motions without a GPU: camera, mannequin, painter, strip, video.

What can be asked for stands here, since `strip` and `video` need Pillow.
"""

from typing import Literal

Style = Literal["row", "path"]  # Strips: figures in a row, or fading along the path.

# Videos: the camera follows the person, or stands still and sees the whole path.
View = Literal["follow", "still"]
