from avln.v1 import common_pb2 as _common_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class PoseFrame(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    POSE_FRAME_UNSPECIFIED: _ClassVar[PoseFrame]
    POSE_FRAME_START: _ClassVar[PoseFrame]
    POSE_FRAME_WORLD: _ClassVar[PoseFrame]

class DistanceRule(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DISTANCE_RULE_UNSPECIFIED: _ClassVar[DistanceRule]
    DISTANCE_RULE_CAMERA_TO_BOX: _ClassVar[DistanceRule]
    DISTANCE_RULE_BASE_TO_VIEWPOINT: _ClassVar[DistanceRule]
    DISTANCE_RULE_CAMERA_TO_MESH: _ClassVar[DistanceRule]

class WrongSubmit(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    WRONG_SUBMIT_UNSPECIFIED: _ClassVar[WrongSubmit]
    WRONG_SUBMIT_KEEPS_GOAL: _ClassVar[WrongSubmit]
    WRONG_SUBMIT_SKIPS_GOAL: _ClassVar[WrongSubmit]

class FeedbackRule(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FEEDBACK_RULE_UNSPECIFIED: _ClassVar[FeedbackRule]
    FEEDBACK_RULE_NONE: _ClassVar[FeedbackRule]
    FEEDBACK_RULE_ACCEPTED: _ClassVar[FeedbackRule]
    FEEDBACK_RULE_VERDICT: _ClassVar[FeedbackRule]

class SoundingRule(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SOUNDING_RULE_UNSPECIFIED: _ClassVar[SoundingRule]
    SOUNDING_RULE_UNFINISHED_IN_DRAWN_ORDER: _ClassVar[SoundingRule]
    SOUNDING_RULE_ALL_IN_GOAL_ORDER: _ClassVar[SoundingRule]

class SilenceRule(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SILENCE_RULE_UNSPECIFIED: _ClassVar[SilenceRule]
    SILENCE_RULE_IMMEDIATE: _ClassVar[SilenceRule]
    SILENCE_RULE_DELAYED: _ClassVar[SilenceRule]
    SILENCE_RULE_WINDOW_END: _ClassVar[SilenceRule]

class ExtraSubmit(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    EXTRA_SUBMIT_UNSPECIFIED: _ClassVar[ExtraSubmit]
    EXTRA_SUBMIT_IGNORED: _ClassVar[ExtraSubmit]
    EXTRA_SUBMIT_ENDS_EPISODE: _ClassVar[ExtraSubmit]

class StopClaims(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    STOP_CLAIMS_UNSPECIFIED: _ClassVar[StopClaims]
    STOP_CLAIMS_ANY_OPEN: _ClassVar[StopClaims]
    STOP_CLAIMS_LAST_ONLY: _ClassVar[StopClaims]

class SoundClip(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SOUND_CLIP_UNSPECIFIED: _ClassVar[SoundClip]
    SOUND_CLIP_ANONYMOUS: _ClassVar[SoundClip]
    SOUND_CLIP_BY_CATEGORY: _ClassVar[SoundClip]
    SOUND_CLIP_DISTINCT: _ClassVar[SoundClip]

class DepthNoise(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DEPTH_NOISE_UNSPECIFIED: _ClassVar[DepthNoise]
    DEPTH_NOISE_NONE: _ClassVar[DepthNoise]
    DEPTH_NOISE_REDWOOD: _ClassVar[DepthNoise]

class RgbNoise(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    RGB_NOISE_UNSPECIFIED: _ClassVar[RgbNoise]
    RGB_NOISE_NONE: _ClassVar[RgbNoise]
    RGB_NOISE_GAUSSIAN: _ClassVar[RgbNoise]
POSE_FRAME_UNSPECIFIED: PoseFrame
POSE_FRAME_START: PoseFrame
POSE_FRAME_WORLD: PoseFrame
DISTANCE_RULE_UNSPECIFIED: DistanceRule
DISTANCE_RULE_CAMERA_TO_BOX: DistanceRule
DISTANCE_RULE_BASE_TO_VIEWPOINT: DistanceRule
DISTANCE_RULE_CAMERA_TO_MESH: DistanceRule
WRONG_SUBMIT_UNSPECIFIED: WrongSubmit
WRONG_SUBMIT_KEEPS_GOAL: WrongSubmit
WRONG_SUBMIT_SKIPS_GOAL: WrongSubmit
FEEDBACK_RULE_UNSPECIFIED: FeedbackRule
FEEDBACK_RULE_NONE: FeedbackRule
FEEDBACK_RULE_ACCEPTED: FeedbackRule
FEEDBACK_RULE_VERDICT: FeedbackRule
SOUNDING_RULE_UNSPECIFIED: SoundingRule
SOUNDING_RULE_UNFINISHED_IN_DRAWN_ORDER: SoundingRule
SOUNDING_RULE_ALL_IN_GOAL_ORDER: SoundingRule
SILENCE_RULE_UNSPECIFIED: SilenceRule
SILENCE_RULE_IMMEDIATE: SilenceRule
SILENCE_RULE_DELAYED: SilenceRule
SILENCE_RULE_WINDOW_END: SilenceRule
EXTRA_SUBMIT_UNSPECIFIED: ExtraSubmit
EXTRA_SUBMIT_IGNORED: ExtraSubmit
EXTRA_SUBMIT_ENDS_EPISODE: ExtraSubmit
STOP_CLAIMS_UNSPECIFIED: StopClaims
STOP_CLAIMS_ANY_OPEN: StopClaims
STOP_CLAIMS_LAST_ONLY: StopClaims
SOUND_CLIP_UNSPECIFIED: SoundClip
SOUND_CLIP_ANONYMOUS: SoundClip
SOUND_CLIP_BY_CATEGORY: SoundClip
SOUND_CLIP_DISTINCT: SoundClip
DEPTH_NOISE_UNSPECIFIED: DepthNoise
DEPTH_NOISE_NONE: DepthNoise
DEPTH_NOISE_REDWOOD: DepthNoise
RGB_NOISE_UNSPECIFIED: RgbNoise
RGB_NOISE_NONE: RgbNoise
RGB_NOISE_GAUSSIAN: RgbNoise

class SensorSubscription(_message.Message):
    __slots__ = ("wishes", "width", "height", "hfov_rad")
    WISHES_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    HFOV_RAD_FIELD_NUMBER: _ClassVar[int]
    wishes: _containers.RepeatedCompositeFieldContainer[SensorWish]
    width: int
    height: int
    hfov_rad: float
    def __init__(self, wishes: _Optional[_Iterable[_Union[SensorWish, _Mapping]]] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., hfov_rad: _Optional[float] = ...) -> None: ...

class SensorWish(_message.Message):
    __slots__ = ("kind", "encodings")
    KIND_FIELD_NUMBER: _ClassVar[int]
    ENCODINGS_FIELD_NUMBER: _ClassVar[int]
    kind: _common_pb2.SensorKind
    encodings: _containers.RepeatedScalarFieldContainer[_common_pb2.Encoding]
    def __init__(self, kind: _Optional[_Union[_common_pb2.SensorKind, str]] = ..., encodings: _Optional[_Iterable[_Union[_common_pb2.Encoding, str]]] = ...) -> None: ...

class TensorSpec(_message.Message):
    __slots__ = ("id", "name", "kind", "dtype", "shape", "encoding", "minimum", "maximum")
    ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    DTYPE_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    MINIMUM_FIELD_NUMBER: _ClassVar[int]
    MAXIMUM_FIELD_NUMBER: _ClassVar[int]
    id: int
    name: str
    kind: _common_pb2.SensorKind
    dtype: _common_pb2.Dtype
    shape: _containers.RepeatedScalarFieldContainer[int]
    encoding: _common_pb2.Encoding
    minimum: float
    maximum: float
    def __init__(self, id: _Optional[int] = ..., name: _Optional[str] = ..., kind: _Optional[_Union[_common_pb2.SensorKind, str]] = ..., dtype: _Optional[_Union[_common_pb2.Dtype, str]] = ..., shape: _Optional[_Iterable[int]] = ..., encoding: _Optional[_Union[_common_pb2.Encoding, str]] = ..., minimum: _Optional[float] = ..., maximum: _Optional[float] = ...) -> None: ...

class TaskSpec(_message.Message):
    __slots__ = ("rules", "forward_m", "turn_deg", "step_s", "max_steps", "body_radius_m", "body_height_m", "width", "height", "hfov_rad", "camera_height_m", "ear_height_m", "depth_max_m", "depth_divisor", "sample_rate_hz", "audio_samples", "samples_per_step", "pose_frame", "success_radius_m", "success_distance", "wrong_submit", "feedback", "sounding", "sounding_window_steps", "sound_clip", "source_lift_m", "depth_noise", "rgb_noise", "head", "silence", "extra_submit", "stop_claims", "distractor_sources", "distractor_sources_per_goal")
    RULES_FIELD_NUMBER: _ClassVar[int]
    FORWARD_M_FIELD_NUMBER: _ClassVar[int]
    TURN_DEG_FIELD_NUMBER: _ClassVar[int]
    STEP_S_FIELD_NUMBER: _ClassVar[int]
    MAX_STEPS_FIELD_NUMBER: _ClassVar[int]
    BODY_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    BODY_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    HFOV_RAD_FIELD_NUMBER: _ClassVar[int]
    CAMERA_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    EAR_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    DEPTH_MAX_M_FIELD_NUMBER: _ClassVar[int]
    DEPTH_DIVISOR_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    AUDIO_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_PER_STEP_FIELD_NUMBER: _ClassVar[int]
    POSE_FRAME_FIELD_NUMBER: _ClassVar[int]
    SUCCESS_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    SUCCESS_DISTANCE_FIELD_NUMBER: _ClassVar[int]
    WRONG_SUBMIT_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_FIELD_NUMBER: _ClassVar[int]
    SOUNDING_FIELD_NUMBER: _ClassVar[int]
    SOUNDING_WINDOW_STEPS_FIELD_NUMBER: _ClassVar[int]
    SOUND_CLIP_FIELD_NUMBER: _ClassVar[int]
    SOURCE_LIFT_M_FIELD_NUMBER: _ClassVar[int]
    DEPTH_NOISE_FIELD_NUMBER: _ClassVar[int]
    RGB_NOISE_FIELD_NUMBER: _ClassVar[int]
    HEAD_FIELD_NUMBER: _ClassVar[int]
    SILENCE_FIELD_NUMBER: _ClassVar[int]
    EXTRA_SUBMIT_FIELD_NUMBER: _ClassVar[int]
    STOP_CLAIMS_FIELD_NUMBER: _ClassVar[int]
    DISTRACTOR_SOURCES_FIELD_NUMBER: _ClassVar[int]
    DISTRACTOR_SOURCES_PER_GOAL_FIELD_NUMBER: _ClassVar[int]
    rules: str
    forward_m: float
    turn_deg: int
    step_s: float
    max_steps: int
    body_radius_m: float
    body_height_m: float
    width: int
    height: int
    hfov_rad: float
    camera_height_m: float
    ear_height_m: float
    depth_max_m: float
    depth_divisor: float
    sample_rate_hz: int
    audio_samples: int
    samples_per_step: int
    pose_frame: PoseFrame
    success_radius_m: float
    success_distance: DistanceRule
    wrong_submit: WrongSubmit
    feedback: FeedbackRule
    sounding: SoundingRule
    sounding_window_steps: int
    sound_clip: SoundClip
    source_lift_m: float
    depth_noise: DepthNoise
    rgb_noise: RgbNoise
    head: str
    silence: SilenceRule
    extra_submit: ExtraSubmit
    stop_claims: StopClaims
    distractor_sources: int
    distractor_sources_per_goal: int
    def __init__(self, rules: _Optional[str] = ..., forward_m: _Optional[float] = ..., turn_deg: _Optional[int] = ..., step_s: _Optional[float] = ..., max_steps: _Optional[int] = ..., body_radius_m: _Optional[float] = ..., body_height_m: _Optional[float] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., hfov_rad: _Optional[float] = ..., camera_height_m: _Optional[float] = ..., ear_height_m: _Optional[float] = ..., depth_max_m: _Optional[float] = ..., depth_divisor: _Optional[float] = ..., sample_rate_hz: _Optional[int] = ..., audio_samples: _Optional[int] = ..., samples_per_step: _Optional[int] = ..., pose_frame: _Optional[_Union[PoseFrame, str]] = ..., success_radius_m: _Optional[float] = ..., success_distance: _Optional[_Union[DistanceRule, str]] = ..., wrong_submit: _Optional[_Union[WrongSubmit, str]] = ..., feedback: _Optional[_Union[FeedbackRule, str]] = ..., sounding: _Optional[_Union[SoundingRule, str]] = ..., sounding_window_steps: _Optional[int] = ..., sound_clip: _Optional[_Union[SoundClip, str]] = ..., source_lift_m: _Optional[float] = ..., depth_noise: _Optional[_Union[DepthNoise, str]] = ..., rgb_noise: _Optional[_Union[RgbNoise, str]] = ..., head: _Optional[str] = ..., silence: _Optional[_Union[SilenceRule, str]] = ..., extra_submit: _Optional[_Union[ExtraSubmit, str]] = ..., stop_claims: _Optional[_Union[StopClaims, str]] = ..., distractor_sources: _Optional[int] = ..., distractor_sources_per_goal: _Optional[int] = ...) -> None: ...

class Mission(_message.Message):
    __slots__ = ("order", "goals")
    ORDER_FIELD_NUMBER: _ClassVar[int]
    GOALS_FIELD_NUMBER: _ClassVar[int]
    order: _common_pb2.Order
    goals: _containers.RepeatedCompositeFieldContainer[Goal]
    def __init__(self, order: _Optional[_Union[_common_pb2.Order, str]] = ..., goals: _Optional[_Iterable[_Union[Goal, _Mapping]]] = ...) -> None: ...

class Goal(_message.Message):
    __slots__ = ("category", "description", "image")
    CATEGORY_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    category: str
    description: str
    image: _common_pb2.Tensor
    def __init__(self, category: _Optional[str] = ..., description: _Optional[str] = ..., image: _Optional[_Union[_common_pb2.Tensor, _Mapping]] = ...) -> None: ...
