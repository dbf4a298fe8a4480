from avln.v1 import common_pb2 as _common_pb2
from avln.v1 import play_pb2 as _play_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class MethodType(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    METHOD_TYPE_UNSPECIFIED: _ClassVar[MethodType]
    METHOD_TYPE_TRAINING_FREE: _ClassVar[MethodType]
    METHOD_TYPE_LEARNT_PERCEPTION: _ClassVar[MethodType]
    METHOD_TYPE_FOUNDATION_MODELS: _ClassVar[MethodType]
    METHOD_TYPE_IMITATION: _ClassVar[MethodType]
    METHOD_TYPE_RL: _ClassVar[MethodType]

class RunState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    RUN_STATE_UNSPECIFIED: _ClassVar[RunState]
    RUN_STATE_CREATED: _ClassVar[RunState]
    RUN_STATE_RUNNING: _ClassVar[RunState]
    RUN_STATE_DRAINING: _ClassVar[RunState]
    RUN_STATE_COMPLETED: _ClassVar[RunState]
    RUN_STATE_FAILED: _ClassVar[RunState]
    RUN_STATE_CANCELLED: _ClassVar[RunState]
    RUN_STATE_EXPIRED: _ClassVar[RunState]

class QuotaWindow(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    QUOTA_WINDOW_UNSPECIFIED: _ClassVar[QuotaWindow]
    QUOTA_WINDOW_DAY: _ClassVar[QuotaWindow]
    QUOTA_WINDOW_MONTH: _ClassVar[QuotaWindow]
    QUOTA_WINDOW_TOTAL: _ClassVar[QuotaWindow]
    QUOTA_WINDOW_CONCURRENT: _ClassVar[QuotaWindow]
    QUOTA_WINDOW_UNCHARGED: _ClassVar[QuotaWindow]

class TokenScope(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    TOKEN_SCOPE_UNSPECIFIED: _ClassVar[TokenScope]
    TOKEN_SCOPE_PARTICIPANT: _ClassVar[TokenScope]
    TOKEN_SCOPE_READ_ONLY: _ClassVar[TokenScope]
    TOKEN_SCOPE_ORGANISER: _ClassVar[TokenScope]
    TOKEN_SCOPE_RUN: _ClassVar[TokenScope]
METHOD_TYPE_UNSPECIFIED: MethodType
METHOD_TYPE_TRAINING_FREE: MethodType
METHOD_TYPE_LEARNT_PERCEPTION: MethodType
METHOD_TYPE_FOUNDATION_MODELS: MethodType
METHOD_TYPE_IMITATION: MethodType
METHOD_TYPE_RL: MethodType
RUN_STATE_UNSPECIFIED: RunState
RUN_STATE_CREATED: RunState
RUN_STATE_RUNNING: RunState
RUN_STATE_DRAINING: RunState
RUN_STATE_COMPLETED: RunState
RUN_STATE_FAILED: RunState
RUN_STATE_CANCELLED: RunState
RUN_STATE_EXPIRED: RunState
QUOTA_WINDOW_UNSPECIFIED: QuotaWindow
QUOTA_WINDOW_DAY: QuotaWindow
QUOTA_WINDOW_MONTH: QuotaWindow
QUOTA_WINDOW_TOTAL: QuotaWindow
QUOTA_WINDOW_CONCURRENT: QuotaWindow
QUOTA_WINDOW_UNCHARGED: QuotaWindow
TOKEN_SCOPE_UNSPECIFIED: TokenScope
TOKEN_SCOPE_PARTICIPANT: TokenScope
TOKEN_SCOPE_READ_ONLY: TokenScope
TOKEN_SCOPE_ORGANISER: TokenScope
TOKEN_SCOPE_RUN: TokenScope

class MethodInfo(_message.Message):
    __slots__ = ("name", "version", "description", "code_url", "paper_url", "weights_licence", "external_data", "method_type")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    CODE_URL_FIELD_NUMBER: _ClassVar[int]
    PAPER_URL_FIELD_NUMBER: _ClassVar[int]
    WEIGHTS_LICENCE_FIELD_NUMBER: _ClassVar[int]
    EXTERNAL_DATA_FIELD_NUMBER: _ClassVar[int]
    METHOD_TYPE_FIELD_NUMBER: _ClassVar[int]
    name: str
    version: str
    description: str
    code_url: str
    paper_url: str
    weights_licence: str
    external_data: str
    method_type: MethodType
    def __init__(self, name: _Optional[str] = ..., version: _Optional[str] = ..., description: _Optional[str] = ..., code_url: _Optional[str] = ..., paper_url: _Optional[str] = ..., weights_licence: _Optional[str] = ..., external_data: _Optional[str] = ..., method_type: _Optional[_Union[MethodType, str]] = ...) -> None: ...

class StartRunRequest(_message.Message):
    __slots__ = ("phase", "order", "method", "client_request_id", "client")
    PHASE_FIELD_NUMBER: _ClassVar[int]
    ORDER_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    CLIENT_REQUEST_ID_FIELD_NUMBER: _ClassVar[int]
    CLIENT_FIELD_NUMBER: _ClassVar[int]
    phase: str
    order: _common_pb2.Order
    method: MethodInfo
    client_request_id: str
    client: _common_pb2.ClientInfo
    def __init__(self, phase: _Optional[str] = ..., order: _Optional[_Union[_common_pb2.Order, str]] = ..., method: _Optional[_Union[MethodInfo, _Mapping]] = ..., client_request_id: _Optional[str] = ..., client: _Optional[_Union[_common_pb2.ClientInfo, _Mapping]] = ...) -> None: ...

class StartRunResponse(_message.Message):
    __slots__ = ("run", "run_token", "max_slots", "time", "quota")
    RUN_FIELD_NUMBER: _ClassVar[int]
    RUN_TOKEN_FIELD_NUMBER: _ClassVar[int]
    MAX_SLOTS_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    QUOTA_FIELD_NUMBER: _ClassVar[int]
    run: Run
    run_token: str
    max_slots: int
    time: _common_pb2.TimeLimits
    quota: Quota
    def __init__(self, run: _Optional[_Union[Run, _Mapping]] = ..., run_token: _Optional[str] = ..., max_slots: _Optional[int] = ..., time: _Optional[_Union[_common_pb2.TimeLimits, _Mapping]] = ..., quota: _Optional[_Union[Quota, _Mapping]] = ...) -> None: ...

class Run(_message.Message):
    __slots__ = ("id", "phase", "order", "method", "state", "state_reason", "state_since_unix_ms", "state_deadline_unix_ms", "created_unix_ms", "ended_unix_ms", "progress", "ends", "eligible", "ineligible_because", "charged", "charge_reason", "metrics", "sealed", "time", "url")
    ID_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    ORDER_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    STATE_REASON_FIELD_NUMBER: _ClassVar[int]
    STATE_SINCE_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    STATE_DEADLINE_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    CREATED_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    ENDED_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    ENDS_FIELD_NUMBER: _ClassVar[int]
    ELIGIBLE_FIELD_NUMBER: _ClassVar[int]
    INELIGIBLE_BECAUSE_FIELD_NUMBER: _ClassVar[int]
    CHARGED_FIELD_NUMBER: _ClassVar[int]
    CHARGE_REASON_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    SEALED_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    URL_FIELD_NUMBER: _ClassVar[int]
    id: str
    phase: str
    order: _common_pb2.Order
    method: MethodInfo
    state: RunState
    state_reason: str
    state_since_unix_ms: int
    state_deadline_unix_ms: int
    created_unix_ms: int
    ended_unix_ms: int
    progress: _common_pb2.RunProgress
    ends: _containers.RepeatedCompositeFieldContainer[_play_pb2.EndCount]
    eligible: bool
    ineligible_because: _containers.RepeatedScalarFieldContainer[str]
    charged: bool
    charge_reason: str
    metrics: _common_pb2.PublicMetrics
    sealed: bool
    time: TimeReport
    url: str
    def __init__(self, id: _Optional[str] = ..., phase: _Optional[str] = ..., order: _Optional[_Union[_common_pb2.Order, str]] = ..., method: _Optional[_Union[MethodInfo, _Mapping]] = ..., state: _Optional[_Union[RunState, str]] = ..., state_reason: _Optional[str] = ..., state_since_unix_ms: _Optional[int] = ..., state_deadline_unix_ms: _Optional[int] = ..., created_unix_ms: _Optional[int] = ..., ended_unix_ms: _Optional[int] = ..., progress: _Optional[_Union[_common_pb2.RunProgress, _Mapping]] = ..., ends: _Optional[_Iterable[_Union[_play_pb2.EndCount, _Mapping]]] = ..., eligible: bool = ..., ineligible_because: _Optional[_Iterable[str]] = ..., charged: bool = ..., charge_reason: _Optional[str] = ..., metrics: _Optional[_Union[_common_pb2.PublicMetrics, _Mapping]] = ..., sealed: bool = ..., time: _Optional[_Union[TimeReport, _Mapping]] = ..., url: _Optional[str] = ...) -> None: ...

class TimeReport(_message.Message):
    __slots__ = ("simulate_ms", "encode_ms", "queue_ms", "think_ms", "disconnected_ms")
    SIMULATE_MS_FIELD_NUMBER: _ClassVar[int]
    ENCODE_MS_FIELD_NUMBER: _ClassVar[int]
    QUEUE_MS_FIELD_NUMBER: _ClassVar[int]
    THINK_MS_FIELD_NUMBER: _ClassVar[int]
    DISCONNECTED_MS_FIELD_NUMBER: _ClassVar[int]
    simulate_ms: int
    encode_ms: int
    queue_ms: int
    think_ms: int
    disconnected_ms: int
    def __init__(self, simulate_ms: _Optional[int] = ..., encode_ms: _Optional[int] = ..., queue_ms: _Optional[int] = ..., think_ms: _Optional[int] = ..., disconnected_ms: _Optional[int] = ...) -> None: ...

class GetRunRequest(_message.Message):
    __slots__ = ("run",)
    RUN_FIELD_NUMBER: _ClassVar[int]
    run: str
    def __init__(self, run: _Optional[str] = ...) -> None: ...

class GetRunResponse(_message.Message):
    __slots__ = ("run",)
    RUN_FIELD_NUMBER: _ClassVar[int]
    run: Run
    def __init__(self, run: _Optional[_Union[Run, _Mapping]] = ...) -> None: ...

class WatchRunRequest(_message.Message):
    __slots__ = ("run",)
    RUN_FIELD_NUMBER: _ClassVar[int]
    run: str
    def __init__(self, run: _Optional[str] = ...) -> None: ...

class WatchRunResponse(_message.Message):
    __slots__ = ("run",)
    RUN_FIELD_NUMBER: _ClassVar[int]
    run: Run
    def __init__(self, run: _Optional[_Union[Run, _Mapping]] = ...) -> None: ...

class CancelRunRequest(_message.Message):
    __slots__ = ("run",)
    RUN_FIELD_NUMBER: _ClassVar[int]
    run: str
    def __init__(self, run: _Optional[str] = ...) -> None: ...

class CancelRunResponse(_message.Message):
    __slots__ = ("run",)
    RUN_FIELD_NUMBER: _ClassVar[int]
    run: Run
    def __init__(self, run: _Optional[_Union[Run, _Mapping]] = ...) -> None: ...

class ListRunsRequest(_message.Message):
    __slots__ = ("phase", "page_size", "page_token")
    PHASE_FIELD_NUMBER: _ClassVar[int]
    PAGE_SIZE_FIELD_NUMBER: _ClassVar[int]
    PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    phase: str
    page_size: int
    page_token: str
    def __init__(self, phase: _Optional[str] = ..., page_size: _Optional[int] = ..., page_token: _Optional[str] = ...) -> None: ...

class ListRunsResponse(_message.Message):
    __slots__ = ("runs", "next_page_token")
    RUNS_FIELD_NUMBER: _ClassVar[int]
    NEXT_PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    runs: _containers.RepeatedCompositeFieldContainer[Run]
    next_page_token: str
    def __init__(self, runs: _Optional[_Iterable[_Union[Run, _Mapping]]] = ..., next_page_token: _Optional[str] = ...) -> None: ...

class GetQuotaRequest(_message.Message):
    __slots__ = ("phase",)
    PHASE_FIELD_NUMBER: _ClassVar[int]
    phase: str
    def __init__(self, phase: _Optional[str] = ...) -> None: ...

class GetQuotaResponse(_message.Message):
    __slots__ = ("quotas",)
    QUOTAS_FIELD_NUMBER: _ClassVar[int]
    quotas: _containers.RepeatedCompositeFieldContainer[Quota]
    def __init__(self, quotas: _Optional[_Iterable[_Union[Quota, _Mapping]]] = ...) -> None: ...

class Quota(_message.Message):
    __slots__ = ("phase", "window", "limit", "used", "remaining", "window_start_unix_s", "next_increase_unix_s", "charges")
    PHASE_FIELD_NUMBER: _ClassVar[int]
    WINDOW_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    USED_FIELD_NUMBER: _ClassVar[int]
    REMAINING_FIELD_NUMBER: _ClassVar[int]
    WINDOW_START_UNIX_S_FIELD_NUMBER: _ClassVar[int]
    NEXT_INCREASE_UNIX_S_FIELD_NUMBER: _ClassVar[int]
    CHARGES_FIELD_NUMBER: _ClassVar[int]
    phase: str
    window: QuotaWindow
    limit: int
    used: int
    remaining: int
    window_start_unix_s: int
    next_increase_unix_s: int
    charges: _containers.RepeatedCompositeFieldContainer[Charge]
    def __init__(self, phase: _Optional[str] = ..., window: _Optional[_Union[QuotaWindow, str]] = ..., limit: _Optional[int] = ..., used: _Optional[int] = ..., remaining: _Optional[int] = ..., window_start_unix_s: _Optional[int] = ..., next_increase_unix_s: _Optional[int] = ..., charges: _Optional[_Iterable[_Union[Charge, _Mapping]]] = ...) -> None: ...

class Charge(_message.Message):
    __slots__ = ("run", "reason")
    RUN_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    run: str
    reason: str
    def __init__(self, run: _Optional[str] = ..., reason: _Optional[str] = ...) -> None: ...

class WhoAmIRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class WhoAmIResponse(_message.Message):
    __slots__ = ("team", "token_name", "scope", "expires_unix_s")
    TEAM_FIELD_NUMBER: _ClassVar[int]
    TOKEN_NAME_FIELD_NUMBER: _ClassVar[int]
    SCOPE_FIELD_NUMBER: _ClassVar[int]
    EXPIRES_UNIX_S_FIELD_NUMBER: _ClassVar[int]
    team: str
    token_name: str
    scope: TokenScope
    expires_unix_s: int
    def __init__(self, team: _Optional[str] = ..., token_name: _Optional[str] = ..., scope: _Optional[_Union[TokenScope, str]] = ..., expires_unix_s: _Optional[int] = ...) -> None: ...
