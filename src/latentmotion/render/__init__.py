"""Pictures and videos of motions without a GPU: camera, mannequin, painter, strip, video."""
