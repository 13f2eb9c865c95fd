"""Features that joints do not depend on, left out of the last layer of a sampler's graph.

HumanML3D's rotations, velocities and contacts are three quarters of its features; joints come from
the others. The last layer of a convolutional VAE makes all features of several frames at once.
"""

from __future__ import annotations

import numpy as np
from onnx import ModelProto, TensorProto, numpy_helper


def without_unused(sampler: ModelProto, joints: ModelProto) -> ModelProto:
    """Returns a sampler's graph that makes the first features alone, those that joints come from.

    Args:
        sampler: Noise to features; the weights are in it. It is changed.
        joints: Features to joints.

    Returns:
        The sampler's graph; unchanged if its last layer is of another kind.
    """
    graph = sampler.graph
    width = graph.output[0].type.tensor_type.shape.dim[2].dim_value
    constants = {tensor.name: numpy_helper.to_array(tensor) for tensor in joints.graph.initializer}
    features = joints.graph.input[0].name
    readers = [node for node in joints.graph.node if features in node.input]
    if any(node.op_type != "Slice" for node in readers):
        return sampler
    used = max(int(constants[node.input[2]][0]) for node in readers)
    arrays = {tensor.name: tensor for tensor in graph.initializer}
    counts = [
        tensor
        for tensor in graph.initializer
        if tensor.data_type == TensorProto.INT64
        and numpy_helper.to_array(tensor).tolist() == [width]
    ]
    names = {tensor.name for tensor in counts}
    counted = {node.op_type for node in graph.node if names.intersection(node.input)}
    last = next((node for node in reversed(graph.node) if node.op_type == "Conv"), None)
    if last is None or used >= width or counted != {"Concat"}:
        return sampler
    casts = {node.output[0]: node.input[0] for node in graph.node if node.op_type == "Cast"}
    layer = [arrays.get(casts.get(name, name), TensorProto()) for name in last.input[1:]]
    frames, rest = divmod(layer[0].dims[0] if layer[0].dims else 0, width)
    if rest or not frames:
        return sampler
    columns = (np.arange(frames)[:, None] * width + np.arange(used)).ravel()
    for tensor in layer:
        _set(tensor, numpy_helper.to_array(tensor)[columns])
    for tensor in graph.initializer:
        if list(tensor.dims) == [width]:
            _set(tensor, numpy_helper.to_array(tensor)[:used])
    for tensor in counts:
        _set(tensor, np.array([used]))
    graph.output[0].type.tensor_type.shape.dim[2].dim_value = used
    return sampler


def _set(tensor: TensorProto, array: np.ndarray) -> None:
    tensor.CopyFrom(numpy_helper.from_array(np.ascontiguousarray(array), tensor.name))
