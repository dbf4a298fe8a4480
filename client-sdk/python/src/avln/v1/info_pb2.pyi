from avln.v1 import common_pb2 as _common_pb2
from avln.v1 import task_pb2 as _task_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ServerState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SERVER_STATE_UNSPECIFIED: _ClassVar[ServerState]
    SERVER_STATE_UP: _ClassVar[ServerState]
    SERVER_STATE_DRAINING: _ClassVar[ServerState]

class PhaseState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    PHASE_STATE_UNSPECIFIED: _ClassVar[PhaseState]
    PHASE_STATE_UPCOMING: _ClassVar[PhaseState]
    PHASE_STATE_OPEN: _ClassVar[PhaseState]
    PHASE_STATE_PAUSED: _ClassVar[PhaseState]
    PHASE_STATE_CLOSED: _ClassVar[PhaseState]

class Visibility(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    VISIBILITY_UNSPECIFIED: _ClassVar[Visibility]
    VISIBILITY_ORGANISER: _ClassVar[Visibility]
    VISIBILITY_TEAM: _ClassVar[Visibility]
    VISIBILITY_PUBLIC: _ClassVar[Visibility]
SERVER_STATE_UNSPECIFIED: ServerState
SERVER_STATE_UP: ServerState
SERVER_STATE_DRAINING: ServerState
PHASE_STATE_UNSPECIFIED: PhaseState
PHASE_STATE_UPCOMING: PhaseState
PHASE_STATE_OPEN: PhaseState
PHASE_STATE_PAUSED: PhaseState
PHASE_STATE_CLOSED: PhaseState
VISIBILITY_UNSPECIFIED: Visibility
VISIBILITY_ORGANISER: Visibility
VISIBILITY_TEAM: Visibility
VISIBILITY_PUBLIC: Visibility

class GetServerInfoRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class GetServerInfoResponse(_message.Message):
    __slots__ = ("name", "version", "api_minor", "benchmark", "digests", "clients", "encodings", "max_request_bytes", "server_time_unix_ms", "state", "notice")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    API_MINOR_FIELD_NUMBER: _ClassVar[int]
    BENCHMARK_FIELD_NUMBER: _ClassVar[int]
    DIGESTS_FIELD_NUMBER: _ClassVar[int]
    CLIENTS_FIELD_NUMBER: _ClassVar[int]
    ENCODINGS_FIELD_NUMBER: _ClassVar[int]
    MAX_REQUEST_BYTES_FIELD_NUMBER: _ClassVar[int]
    SERVER_TIME_UNIX_MS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    NOTICE_FIELD_NUMBER: _ClassVar[int]
    name: str
    version: str
    api_minor: int
    benchmark: str
    digests: _common_pb2.Digests
    clients: _containers.RepeatedCompositeFieldContainer[ClientRange]
    encodings: _containers.RepeatedScalarFieldContainer[_common_pb2.Encoding]
    max_request_bytes: int
    server_time_unix_ms: int
    state: ServerState
    notice: str
    def __init__(self, name: _Optional[str] = ..., version: _Optional[str] = ..., api_minor: _Optional[int] = ..., benchmark: _Optional[str] = ..., digests: _Optional[_Union[_common_pb2.Digests, _Mapping]] = ..., clients: _Optional[_Iterable[_Union[ClientRange, _Mapping]]] = ..., encodings: _Optional[_Iterable[_Union[_common_pb2.Encoding, str]]] = ..., max_request_bytes: _Optional[int] = ..., server_time_unix_ms: _Optional[int] = ..., state: _Optional[_Union[ServerState, str]] = ..., notice: _Optional[str] = ...) -> None: ...

class ClientRange(_message.Message):
    __slots__ = ("name", "min_version", "max_version", "min_api_minor", "install")
    NAME_FIELD_NUMBER: _ClassVar[int]
    MIN_VERSION_FIELD_NUMBER: _ClassVar[int]
    MAX_VERSION_FIELD_NUMBER: _ClassVar[int]
    MIN_API_MINOR_FIELD_NUMBER: _ClassVar[int]
    INSTALL_FIELD_NUMBER: _ClassVar[int]
    name: str
    min_version: str
    max_version: str
    min_api_minor: int
    install: str
    def __init__(self, name: _Optional[str] = ..., min_version: _Optional[str] = ..., max_version: _Optional[str] = ..., min_api_minor: _Optional[int] = ..., install: _Optional[str] = ...) -> None: ...

class ListPhasesRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class ListPhasesResponse(_message.Message):
    __slots__ = ("phases",)
    PHASES_FIELD_NUMBER: _ClassVar[int]
    phases: _containers.RepeatedCompositeFieldContainer[Phase]
    def __init__(self, phases: _Optional[_Iterable[_Union[Phase, _Mapping]]] = ...) -> None: ...

class Phase(_message.Message):
    __slots__ = ("id", "title", "description", "orders", "episodes", "max_slots", "feedback", "sensors", "encodings", "state", "state_reason", "opens_unix_s", "closes_unix_s", "time", "results", "rules", "sealed", "max_side", "commitment", "revealed")
    ID_FIELD_NUMBER: _ClassVar[int]
    TITLE_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    ORDERS_FIELD_NUMBER: _ClassVar[int]
    EPISODES_FIELD_NUMBER: _ClassVar[int]
    MAX_SLOTS_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_FIELD_NUMBER: _ClassVar[int]
    SENSORS_FIELD_NUMBER: _ClassVar[int]
    ENCODINGS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    STATE_REASON_FIELD_NUMBER: _ClassVar[int]
    OPENS_UNIX_S_FIELD_NUMBER: _ClassVar[int]
    CLOSES_UNIX_S_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    RESULTS_FIELD_NUMBER: _ClassVar[int]
    RULES_FIELD_NUMBER: _ClassVar[int]
    SEALED_FIELD_NUMBER: _ClassVar[int]
    MAX_SIDE_FIELD_NUMBER: _ClassVar[int]
    COMMITMENT_FIELD_NUMBER: _ClassVar[int]
    REVEALED_FIELD_NUMBER: _ClassVar[int]
    id: str
    title: str
    description: str
    orders: _containers.RepeatedScalarFieldContainer[_common_pb2.Order]
    episodes: int
    max_slots: int
    feedback: _task_pb2.FeedbackRule
    sensors: _containers.RepeatedScalarFieldContainer[_common_pb2.SensorKind]
    encodings: _containers.RepeatedScalarFieldContainer[_common_pb2.Encoding]
    state: PhaseState
    state_reason: str
    opens_unix_s: int
    closes_unix_s: int
    time: _common_pb2.TimeLimits
    results: Visibility
    rules: str
    sealed: bool
    max_side: int
    commitment: str
    revealed: Revealed
    def __init__(self, id: _Optional[str] = ..., title: _Optional[str] = ..., description: _Optional[str] = ..., orders: _Optional[_Iterable[_Union[_common_pb2.Order, str]]] = ..., episodes: _Optional[int] = ..., max_slots: _Optional[int] = ..., feedback: _Optional[_Union[_task_pb2.FeedbackRule, str]] = ..., sensors: _Optional[_Iterable[_Union[_common_pb2.SensorKind, str]]] = ..., encodings: _Optional[_Iterable[_Union[_common_pb2.Encoding, str]]] = ..., state: _Optional[_Union[PhaseState, str]] = ..., state_reason: _Optional[str] = ..., opens_unix_s: _Optional[int] = ..., closes_unix_s: _Optional[int] = ..., time: _Optional[_Union[_common_pb2.TimeLimits, _Mapping]] = ..., results: _Optional[_Union[Visibility, str]] = ..., rules: _Optional[str] = ..., sealed: bool = ..., max_side: _Optional[int] = ..., commitment: _Optional[str] = ..., revealed: _Optional[_Union[Revealed, _Mapping]] = ...) -> None: ...

class Revealed(_message.Message):
    __slots__ = ("pool", "scorer", "secret")
    POOL_FIELD_NUMBER: _ClassVar[int]
    SCORER_FIELD_NUMBER: _ClassVar[int]
    SECRET_FIELD_NUMBER: _ClassVar[int]
    pool: str
    scorer: str
    secret: str
    def __init__(self, pool: _Optional[str] = ..., scorer: _Optional[str] = ..., secret: _Optional[str] = ...) -> None: ...
