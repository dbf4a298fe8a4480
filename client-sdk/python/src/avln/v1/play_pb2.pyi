from avln.v1 import common_pb2 as _common_pb2
from avln.v1 import task_pb2 as _task_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SubmitFeedback(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SUBMIT_FEEDBACK_UNSPECIFIED: _ClassVar[SubmitFeedback]
    SUBMIT_FEEDBACK_ACCEPTED: _ClassVar[SubmitFeedback]
    SUBMIT_FEEDBACK_CORRECT: _ClassVar[SubmitFeedback]
    SUBMIT_FEEDBACK_WRONG: _ClassVar[SubmitFeedback]

class NoticeKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    NOTICE_KIND_UNSPECIFIED: _ClassVar[NoticeKind]
    NOTICE_KIND_DRAINING: _ClassVar[NoticeKind]
    NOTICE_KIND_BUDGET_LOW: _ClassVar[NoticeKind]
    NOTICE_KIND_MAINTENANCE: _ClassVar[NoticeKind]
    NOTICE_KIND_CLIENT_DEPRECATED: _ClassVar[NoticeKind]
SUBMIT_FEEDBACK_UNSPECIFIED: SubmitFeedback
SUBMIT_FEEDBACK_ACCEPTED: SubmitFeedback
SUBMIT_FEEDBACK_CORRECT: SubmitFeedback
SUBMIT_FEEDBACK_WRONG: SubmitFeedback
NOTICE_KIND_UNSPECIFIED: NoticeKind
NOTICE_KIND_DRAINING: NoticeKind
NOTICE_KIND_BUDGET_LOW: NoticeKind
NOTICE_KIND_MAINTENANCE: NoticeKind
NOTICE_KIND_CLIENT_DEPRECATED: NoticeKind

class PlayRequest(_message.Message):
    __slots__ = ("hello", "ready", "act", "abandon", "pong", "goodbye")
    HELLO_FIELD_NUMBER: _ClassVar[int]
    READY_FIELD_NUMBER: _ClassVar[int]
    ACT_FIELD_NUMBER: _ClassVar[int]
    ABANDON_FIELD_NUMBER: _ClassVar[int]
    PONG_FIELD_NUMBER: _ClassVar[int]
    GOODBYE_FIELD_NUMBER: _ClassVar[int]
    hello: Hello
    ready: Ready
    act: Act
    abandon: Abandon
    pong: Pong
    goodbye: Goodbye
    def __init__(self, hello: _Optional[_Union[Hello, _Mapping]] = ..., ready: _Optional[_Union[Ready, _Mapping]] = ..., act: _Optional[_Union[Act, _Mapping]] = ..., abandon: _Optional[_Union[Abandon, _Mapping]] = ..., pong: _Optional[_Union[Pong, _Mapping]] = ..., goodbye: _Optional[_Union[Goodbye, _Mapping]] = ...) -> None: ...

class PlayResponse(_message.Message):
    __slots__ = ("welcome", "episode_start", "observation", "episode_end", "ping", "notice", "fault", "run_end")
    WELCOME_FIELD_NUMBER: _ClassVar[int]
    EPISODE_START_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_FIELD_NUMBER: _ClassVar[int]
    EPISODE_END_FIELD_NUMBER: _ClassVar[int]
    PING_FIELD_NUMBER: _ClassVar[int]
    NOTICE_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    RUN_END_FIELD_NUMBER: _ClassVar[int]
    welcome: Welcome
    episode_start: EpisodeStart
    observation: Observation
    episode_end: EpisodeEnd
    ping: Ping
    notice: Notice
    fault: Fault
    run_end: RunEnd
    def __init__(self, welcome: _Optional[_Union[Welcome, _Mapping]] = ..., episode_start: _Optional[_Union[EpisodeStart, _Mapping]] = ..., observation: _Optional[_Union[Observation, _Mapping]] = ..., episode_end: _Optional[_Union[EpisodeEnd, _Mapping]] = ..., ping: _Optional[_Union[Ping, _Mapping]] = ..., notice: _Optional[_Union[Notice, _Mapping]] = ..., fault: _Optional[_Union[Fault, _Mapping]] = ..., run_end: _Optional[_Union[RunEnd, _Mapping]] = ...) -> None: ...

class Hello(_message.Message):
    __slots__ = ("run", "client", "slots", "sensors", "resume", "known")
    RUN_FIELD_NUMBER: _ClassVar[int]
    CLIENT_FIELD_NUMBER: _ClassVar[int]
    SLOTS_FIELD_NUMBER: _ClassVar[int]
    SENSORS_FIELD_NUMBER: _ClassVar[int]
    RESUME_FIELD_NUMBER: _ClassVar[int]
    KNOWN_FIELD_NUMBER: _ClassVar[int]
    run: str
    client: _common_pb2.ClientInfo
    slots: int
    sensors: _task_pb2.SensorSubscription
    resume: bool
    known: _containers.RepeatedCompositeFieldContainer[SlotPosition]
    def __init__(self, run: _Optional[str] = ..., client: _Optional[_Union[_common_pb2.ClientInfo, _Mapping]] = ..., slots: _Optional[int] = ..., sensors: _Optional[_Union[_task_pb2.SensorSubscription, _Mapping]] = ..., resume: bool = ..., known: _Optional[_Iterable[_Union[SlotPosition, _Mapping]]] = ...) -> None: ...

class SlotPosition(_message.Message):
    __slots__ = ("slot", "episode", "step")
    SLOT_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    slot: int
    episode: str
    step: int
    def __init__(self, slot: _Optional[int] = ..., episode: _Optional[str] = ..., step: _Optional[int] = ...) -> None: ...

class Ready(_message.Message):
    __slots__ = ("slot",)
    SLOT_FIELD_NUMBER: _ClassVar[int]
    slot: int
    def __init__(self, slot: _Optional[int] = ...) -> None: ...

class Act(_message.Message):
    __slots__ = ("slot", "episode", "step", "action")
    SLOT_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    slot: int
    episode: str
    step: int
    action: _common_pb2.Action
    def __init__(self, slot: _Optional[int] = ..., episode: _Optional[str] = ..., step: _Optional[int] = ..., action: _Optional[_Union[_common_pb2.Action, str]] = ...) -> None: ...

class Abandon(_message.Message):
    __slots__ = ("slot", "episode", "step")
    SLOT_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    slot: int
    episode: str
    step: int
    def __init__(self, slot: _Optional[int] = ..., episode: _Optional[str] = ..., step: _Optional[int] = ...) -> None: ...

class Pong(_message.Message):
    __slots__ = ("nonce",)
    NONCE_FIELD_NUMBER: _ClassVar[int]
    nonce: int
    def __init__(self, nonce: _Optional[int] = ...) -> None: ...

class Goodbye(_message.Message):
    __slots__ = ("pause",)
    PAUSE_FIELD_NUMBER: _ClassVar[int]
    pause: bool
    def __init__(self, pause: bool = ...) -> None: ...

class Welcome(_message.Message):
    __slots__ = ("run", "api_minor", "slots", "task", "tensors", "max_message_bytes", "time", "progress", "resumed", "digests", "benchmark", "server_version", "sealed", "server_time_unix_ms", "run_deadline_unix_ms")
    RUN_FIELD_NUMBER: _ClassVar[int]
    API_MINOR_FIELD_NUMBER: _ClassVar[int]
    SLOTS_FIELD_NUMBER: _ClassVar[int]
    TASK_FIELD_NUMBER: _ClassVar[int]
    TENSORS_FIELD_NUMBER: _ClassVar[int]
    MAX_MESSAGE_BYTES_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    RESUMED_FIELD_NUMBER: _ClassVar[int]
    DIGESTS_FIELD_NUMBER: _ClassVar[int]
    BENCHMARK_FIELD_NUMBER: _ClassVar[int]
    SERVER_VERSION_FIELD_NUMBER: _ClassVar[int]
    SEALED_FIELD_NUMBER: _ClassVar[int]
    SERVER_TIME_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    RUN_DEADLINE_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    run: str
    api_minor: int
    slots: int
    task: _task_pb2.TaskSpec
    tensors: _containers.RepeatedCompositeFieldContainer[_task_pb2.TensorSpec]
    max_message_bytes: int
    time: _common_pb2.TimeLimits
    progress: _common_pb2.RunProgress
    resumed: _containers.RepeatedCompositeFieldContainer[SlotPosition]
    digests: _common_pb2.Digests
    benchmark: str
    server_version: str
    sealed: bool
    server_time_unix_ms: int
    run_deadline_unix_ms: int
    def __init__(self, run: _Optional[str] = ..., api_minor: _Optional[int] = ..., slots: _Optional[int] = ..., task: _Optional[_Union[_task_pb2.TaskSpec, _Mapping]] = ..., tensors: _Optional[_Iterable[_Union[_task_pb2.TensorSpec, _Mapping]]] = ..., max_message_bytes: _Optional[int] = ..., time: _Optional[_Union[_common_pb2.TimeLimits, _Mapping]] = ..., progress: _Optional[_Union[_common_pb2.RunProgress, _Mapping]] = ..., resumed: _Optional[_Iterable[_Union[SlotPosition, _Mapping]]] = ..., digests: _Optional[_Union[_common_pb2.Digests, _Mapping]] = ..., benchmark: _Optional[str] = ..., server_version: _Optional[str] = ..., sealed: bool = ..., server_time_unix_ms: _Optional[int] = ..., run_deadline_unix_ms: _Optional[int] = ...) -> None: ...

class EpisodeStart(_message.Message):
    __slots__ = ("slot", "episode", "mission", "observation", "ordinal", "progress")
    SLOT_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    MISSION_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_FIELD_NUMBER: _ClassVar[int]
    ORDINAL_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    slot: int
    episode: str
    mission: _task_pb2.Mission
    observation: Observation
    ordinal: int
    progress: _common_pb2.RunProgress
    def __init__(self, slot: _Optional[int] = ..., episode: _Optional[str] = ..., mission: _Optional[_Union[_task_pb2.Mission, _Mapping]] = ..., observation: _Optional[_Union[Observation, _Mapping]] = ..., ordinal: _Optional[int] = ..., progress: _Optional[_Union[_common_pb2.RunProgress, _Mapping]] = ...) -> None: ...

class Observation(_message.Message):
    __slots__ = ("slot", "episode", "step", "tensors", "pose", "remaining_steps", "remaining_submits", "feedback", "terminated", "truncated", "reason", "time")
    SLOT_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    TENSORS_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    REMAINING_STEPS_FIELD_NUMBER: _ClassVar[int]
    REMAINING_SUBMITS_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_FIELD_NUMBER: _ClassVar[int]
    TERMINATED_FIELD_NUMBER: _ClassVar[int]
    TRUNCATED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    slot: int
    episode: str
    step: int
    tensors: _containers.RepeatedCompositeFieldContainer[_common_pb2.Tensor]
    pose: _common_pb2.Pose
    remaining_steps: int
    remaining_submits: int
    feedback: SubmitFeedback
    terminated: bool
    truncated: bool
    reason: _common_pb2.EndReason
    time: TimeAccount
    def __init__(self, slot: _Optional[int] = ..., episode: _Optional[str] = ..., step: _Optional[int] = ..., tensors: _Optional[_Iterable[_Union[_common_pb2.Tensor, _Mapping]]] = ..., pose: _Optional[_Union[_common_pb2.Pose, _Mapping]] = ..., remaining_steps: _Optional[int] = ..., remaining_submits: _Optional[int] = ..., feedback: _Optional[_Union[SubmitFeedback, str]] = ..., terminated: bool = ..., truncated: bool = ..., reason: _Optional[_Union[_common_pb2.EndReason, str]] = ..., time: _Optional[_Union[TimeAccount, _Mapping]] = ...) -> None: ...

class TimeAccount(_message.Message):
    __slots__ = ("step_ms", "bank_ms")
    STEP_MS_FIELD_NUMBER: _ClassVar[int]
    BANK_MS_FIELD_NUMBER: _ClassVar[int]
    step_ms: int
    bank_ms: int
    def __init__(self, step_ms: _Optional[int] = ..., bank_ms: _Optional[int] = ...) -> None: ...

class EpisodeEnd(_message.Message):
    __slots__ = ("slot", "episode", "step", "reason", "terminated", "metrics", "progress")
    SLOT_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    TERMINATED_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    slot: int
    episode: str
    step: int
    reason: _common_pb2.EndReason
    terminated: bool
    metrics: _common_pb2.PublicMetrics
    progress: _common_pb2.RunProgress
    def __init__(self, slot: _Optional[int] = ..., episode: _Optional[str] = ..., step: _Optional[int] = ..., reason: _Optional[_Union[_common_pb2.EndReason, str]] = ..., terminated: bool = ..., metrics: _Optional[_Union[_common_pb2.PublicMetrics, _Mapping]] = ..., progress: _Optional[_Union[_common_pb2.RunProgress, _Mapping]] = ...) -> None: ...

class Ping(_message.Message):
    __slots__ = ("nonce", "server_time_unix_ms", "run_remaining_s")
    NONCE_FIELD_NUMBER: _ClassVar[int]
    SERVER_TIME_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    RUN_REMAINING_S_FIELD_NUMBER: _ClassVar[int]
    nonce: int
    server_time_unix_ms: int
    run_remaining_s: int
    def __init__(self, nonce: _Optional[int] = ..., server_time_unix_ms: _Optional[int] = ..., run_remaining_s: _Optional[int] = ...) -> None: ...

class Notice(_message.Message):
    __slots__ = ("kind", "message", "effective_unix_ms")
    KIND_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    EFFECTIVE_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    kind: NoticeKind
    message: str
    effective_unix_ms: int
    def __init__(self, kind: _Optional[_Union[NoticeKind, str]] = ..., message: _Optional[str] = ..., effective_unix_ms: _Optional[int] = ...) -> None: ...

class Fault(_message.Message):
    __slots__ = ("slot", "episode", "step", "code", "reason", "message", "recoverable", "retry_after_s", "id")
    SLOT_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    CODE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    RECOVERABLE_FIELD_NUMBER: _ClassVar[int]
    RETRY_AFTER_S_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    slot: int
    episode: str
    step: int
    code: int
    reason: _common_pb2.Reason
    message: str
    recoverable: bool
    retry_after_s: int
    id: str
    def __init__(self, slot: _Optional[int] = ..., episode: _Optional[str] = ..., step: _Optional[int] = ..., code: _Optional[int] = ..., reason: _Optional[_Union[_common_pb2.Reason, str]] = ..., message: _Optional[str] = ..., recoverable: bool = ..., retry_after_s: _Optional[int] = ..., id: _Optional[str] = ...) -> None: ...

class RunEnd(_message.Message):
    __slots__ = ("run", "progress", "ends", "metrics", "complete", "url")
    RUN_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    ENDS_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    COMPLETE_FIELD_NUMBER: _ClassVar[int]
    URL_FIELD_NUMBER: _ClassVar[int]
    run: str
    progress: _common_pb2.RunProgress
    ends: _containers.RepeatedCompositeFieldContainer[EndCount]
    metrics: _common_pb2.PublicMetrics
    complete: bool
    url: str
    def __init__(self, run: _Optional[str] = ..., progress: _Optional[_Union[_common_pb2.RunProgress, _Mapping]] = ..., ends: _Optional[_Iterable[_Union[EndCount, _Mapping]]] = ..., metrics: _Optional[_Union[_common_pb2.PublicMetrics, _Mapping]] = ..., complete: bool = ..., url: _Optional[str] = ...) -> None: ...

class EndCount(_message.Message):
    __slots__ = ("reason", "episodes")
    REASON_FIELD_NUMBER: _ClassVar[int]
    EPISODES_FIELD_NUMBER: _ClassVar[int]
    reason: _common_pb2.EndReason
    episodes: int
    def __init__(self, reason: _Optional[_Union[_common_pb2.EndReason, str]] = ..., episodes: _Optional[int] = ...) -> None: ...

class ResetRequest(_message.Message):
    __slots__ = ("hello", "ready")
    HELLO_FIELD_NUMBER: _ClassVar[int]
    READY_FIELD_NUMBER: _ClassVar[int]
    hello: Hello
    ready: Ready
    def __init__(self, hello: _Optional[_Union[Hello, _Mapping]] = ..., ready: _Optional[_Union[Ready, _Mapping]] = ...) -> None: ...

class ResetResponse(_message.Message):
    __slots__ = ("welcome", "episode_start", "run_end")
    WELCOME_FIELD_NUMBER: _ClassVar[int]
    EPISODE_START_FIELD_NUMBER: _ClassVar[int]
    RUN_END_FIELD_NUMBER: _ClassVar[int]
    welcome: Welcome
    episode_start: EpisodeStart
    run_end: RunEnd
    def __init__(self, welcome: _Optional[_Union[Welcome, _Mapping]] = ..., episode_start: _Optional[_Union[EpisodeStart, _Mapping]] = ..., run_end: _Optional[_Union[RunEnd, _Mapping]] = ...) -> None: ...

class StepRequest(_message.Message):
    __slots__ = ("act",)
    ACT_FIELD_NUMBER: _ClassVar[int]
    act: Act
    def __init__(self, act: _Optional[_Union[Act, _Mapping]] = ...) -> None: ...

class StepResponse(_message.Message):
    __slots__ = ("observation", "episode_end")
    OBSERVATION_FIELD_NUMBER: _ClassVar[int]
    EPISODE_END_FIELD_NUMBER: _ClassVar[int]
    observation: Observation
    episode_end: EpisodeEnd
    def __init__(self, observation: _Optional[_Union[Observation, _Mapping]] = ..., episode_end: _Optional[_Union[EpisodeEnd, _Mapping]] = ...) -> None: ...

class EndRequest(_message.Message):
    __slots__ = ("abandon", "goodbye")
    ABANDON_FIELD_NUMBER: _ClassVar[int]
    GOODBYE_FIELD_NUMBER: _ClassVar[int]
    abandon: Abandon
    goodbye: Goodbye
    def __init__(self, abandon: _Optional[_Union[Abandon, _Mapping]] = ..., goodbye: _Optional[_Union[Goodbye, _Mapping]] = ...) -> None: ...

class EndResponse(_message.Message):
    __slots__ = ("episode_end", "run_end")
    EPISODE_END_FIELD_NUMBER: _ClassVar[int]
    RUN_END_FIELD_NUMBER: _ClassVar[int]
    episode_end: EpisodeEnd
    run_end: RunEnd
    def __init__(self, episode_end: _Optional[_Union[EpisodeEnd, _Mapping]] = ..., run_end: _Optional[_Union[RunEnd, _Mapping]] = ...) -> None: ...
