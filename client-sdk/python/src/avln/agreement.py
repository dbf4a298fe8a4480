"""Agreement between client and server: task, and decoding of observations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avln import codec
from avln.connect_options import MAX_MESSAGE_BYTES
from avln.errors import ProtocolError
from avln.observation import Feedback, Observation, Pose
from avln.summary import Progress
from avln.task import TaskSpec
from avln.v1 import common_pb2 as v1
from avln.version import API_MINOR

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avln.packing import Packing
    from avln.task import Sensors
    from avln.v1 import play_pb2, task_pb2

_NAMES = {v1.SENSOR_KIND_RGB: "rgb", v1.SENSOR_KIND_DEPTH: "depth", v1.SENSOR_KIND_AUDIO: "audio"}
_DTYPES = {v1.SENSOR_KIND_RGB: v1.DTYPE_U8, v1.SENSOR_KIND_DEPTH: v1.DTYPE_F32, v1.SENSOR_KIND_AUDIO: v1.DTYPE_F32}


class Agreement:
    """Settings agreed between client and server in Welcome."""

    def __init__(self, welcome: play_pb2.Welcome, wanted: Sensors, packing: Packing) -> None:
        """Checks that Welcome provides the `wanted` sensors in decodable form.

        Raises:
            ProtocolError: if a value is missing or invalid.
        """
        self.task = TaskSpec.from_wire(welcome.task)
        self.run = welcome.run
        self.slots = welcome.slots
        self.progress = Progress.from_wire(welcome.progress)
        self.may_be_away_s = welcome.time.disconnect_s
        self.run_deadline_unix_ms = welcome.run_deadline_unix_ms
        _check_limits(welcome)
        _check_size(self.task, wanted)
        self._depth_divisor = welcome.task.depth_divisor
        self._tensors = {spec.id: spec for spec in _wanted_tensors(welcome, wanted, packing, self.task)}

    def unpack(self, seen: play_pb2.Observation) -> Observation:
        """Decodes an observation message.

        Raises:
            ProtocolError: if it violates the agreement.
        """
        if not seen.HasField("pose"):
            raise ProtocolError(f"observation {seen.step} has no pose")
        tensors: dict[str, Any] = {}
        for tensor in seen.tensors:
            spec = self._tensors.get(tensor.id)
            if spec is not None:
                tensors[_NAMES[spec.kind]] = self._unpack_tensor(spec, tensor, seen.step)
        for spec in self._tensors.values():
            if _NAMES[spec.kind] not in tensors:
                raise ProtocolError(f"observation {seen.step} has no tensor {spec.name}")
        pose = seen.pose
        return Observation(
            step=seen.step,
            pose=Pose(pose.x_m, pose.y_m, pose.z_m, pose.heading_rad),
            remaining_steps=seen.remaining_steps,
            remaining_submits=seen.remaining_submits,
            feedback=Feedback.from_wire(seen.feedback),
            **tensors,
        )

    def _unpack_tensor(self, spec: task_pb2.TensorSpec, tensor: v1.Tensor, step: int) -> NDArray[Any]:
        _check_tensor(spec, tensor)
        try:
            return self._decode(spec.kind, tensor)
        except codec.CodecError as error:
            raise ProtocolError(f"tensor {spec.name} of observation {step}: {error}") from None

    def _decode(self, kind: int, tensor: v1.Tensor) -> NDArray[Any]:
        height, width = self.task.height, self.task.width
        if kind == v1.SENSOR_KIND_RGB:
            return codec.decode_rgb(tensor.encoding, tensor.data, height, width)
        if kind == v1.SENSOR_KIND_AUDIO:
            return codec.decode_audio(tensor.encoding, tensor.data, self.task.audio_samples)
        divisor = self._depth_divisor
        depth = codec.decode_depth(tensor.encoding, tensor.data, height, width, divisor)
        return depth if divisor == 1.0 else depth * np.float32(divisor)


def _check_limits(welcome: play_pb2.Welcome) -> None:
    if welcome.api_minor > API_MINOR:
        raise ProtocolError(f"expected avln.v1 minor {API_MINOR} or lower, got minor {welcome.api_minor}")
    if welcome.slots == 0:
        raise ProtocolError("Welcome grants no slot")
    if welcome.max_message_bytes > MAX_MESSAGE_BYTES:
        raise ProtocolError(
            f"message size: expected at most {MAX_MESSAGE_BYTES} bytes, got {welcome.max_message_bytes}; "
            "request smaller images"
        )


def _check_size(task: TaskSpec, wanted: Sensors) -> None:
    if (task.width, task.height) != (wanted.width, wanted.height):
        raise ProtocolError(
            f"Welcome: expected {wanted.width} x {wanted.height} pixels, got {task.width} x {task.height}"
        )


def _wanted_tensors(
    welcome: play_pb2.Welcome, wanted: Sensors, packing: Packing, task: TaskSpec
) -> list[task_pb2.TensorSpec]:
    """Returns the checked layouts of the requested sensors."""
    offered = {spec.kind: spec for spec in welcome.tensors}
    for kind in wanted.kinds():
        if kind not in offered:
            raise ProtocolError(f"Welcome lists no tensor for {_NAMES[kind]}")
        _check_spec(offered[kind], packing, task)
    return [offered[kind] for kind in wanted.kinds()]


def _check_spec(spec: task_pb2.TensorSpec, packing: Packing, task: TaskSpec) -> None:
    shape = {
        v1.SENSOR_KIND_RGB: [task.height, task.width, 3],
        v1.SENSOR_KIND_DEPTH: [task.height, task.width],
        v1.SENSOR_KIND_AUDIO: [2, task.audio_samples],
    }[spec.kind]
    wished = packing.wishes(spec.kind)
    if spec.dtype != _DTYPES[spec.kind] or list(spec.shape) != shape or spec.encoding not in wished:
        raise ProtocolError(
            f"tensor {spec.name}: expected {_enum_name(v1.Dtype, _DTYPES[spec.kind])} {shape} "
            f"{' or '.join(_enum_name(v1.Encoding, encoding) for encoding in wished)}, "
            f"got {_enum_name(v1.Dtype, spec.dtype)} {list(spec.shape)} {_enum_name(v1.Encoding, spec.encoding)}"
        )


def _check_tensor(spec: task_pb2.TensorSpec, tensor: v1.Tensor) -> None:
    # A server may send raw numbers in place of the agreed encoding.
    agreed = tensor.dtype == spec.dtype and tensor.encoding in (spec.encoding, v1.ENCODING_RAW)
    if not agreed or tensor.shape != spec.shape:
        raise ProtocolError(
            f"tensor {spec.name}: expected {list(spec.shape)} as {_enum_name(v1.Encoding, spec.encoding)}, "
            f"got {list(tensor.shape)} as {_enum_name(v1.Encoding, tensor.encoding)}"
        )


def _enum_name(enum: Any, number: int) -> str:
    return str(enum.Name(number)) if number in enum.values() else str(number)
