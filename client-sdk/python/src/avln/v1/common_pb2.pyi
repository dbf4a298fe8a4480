from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Order(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ORDER_UNSPECIFIED: _ClassVar[Order]
    ORDER_ORDERED: _ClassVar[Order]
    ORDER_UNORDERED: _ClassVar[Order]

class Action(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ACTION_UNSPECIFIED: _ClassVar[Action]
    ACTION_MOVE_FORWARD: _ClassVar[Action]
    ACTION_TURN_LEFT: _ClassVar[Action]
    ACTION_TURN_RIGHT: _ClassVar[Action]
    ACTION_SUBMIT: _ClassVar[Action]
    ACTION_STOP: _ClassVar[Action]

class EndReason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    END_REASON_UNSPECIFIED: _ClassVar[EndReason]
    END_REASON_STOPPED: _ClassVar[EndReason]
    END_REASON_FINAL_SUBMIT: _ClassVar[EndReason]
    END_REASON_STEP_LIMIT: _ClassVar[EndReason]
    END_REASON_TIME_BUDGET: _ClassVar[EndReason]
    END_REASON_ABANDONED: _ClassVar[EndReason]
    END_REASON_DISCONNECTED: _ClassVar[EndReason]
    END_REASON_SERVER_FAULT: _ClassVar[EndReason]

class SensorKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SENSOR_KIND_UNSPECIFIED: _ClassVar[SensorKind]
    SENSOR_KIND_RGB: _ClassVar[SensorKind]
    SENSOR_KIND_DEPTH: _ClassVar[SensorKind]
    SENSOR_KIND_AUDIO: _ClassVar[SensorKind]

class Dtype(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DTYPE_UNSPECIFIED: _ClassVar[Dtype]
    DTYPE_U8: _ClassVar[Dtype]
    DTYPE_U16: _ClassVar[Dtype]
    DTYPE_I16: _ClassVar[Dtype]
    DTYPE_F32: _ClassVar[Dtype]

class Encoding(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ENCODING_UNSPECIFIED: _ClassVar[Encoding]
    ENCODING_RAW: _ClassVar[Encoding]
    ENCODING_PNG: _ClassVar[Encoding]
    ENCODING_QOI: _ClassVar[Encoding]
    ENCODING_DEPTH_U16_MM: _ClassVar[Encoding]
    ENCODING_AUDIO_I16: _ClassVar[Encoding]
    ENCODING_PACKED: _ClassVar[Encoding]
    ENCODING_DEPTH_U16_MM_PACKED: _ClassVar[Encoding]

class Reason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    REASON_UNSPECIFIED: _ClassVar[Reason]
    REASON_TOKEN_MISSING: _ClassVar[Reason]
    REASON_TOKEN_MALFORMED: _ClassVar[Reason]
    REASON_TOKEN_EXPIRED: _ClassVar[Reason]
    REASON_TOKEN_REVOKED: _ClassVar[Reason]
    REASON_TEAM_NOT_APPROVED: _ClassVar[Reason]
    REASON_PHASE_NOT_VISIBLE: _ClassVar[Reason]
    REASON_QUOTA_DAY: _ClassVar[Reason]
    REASON_QUOTA_MONTH: _ClassVar[Reason]
    REASON_QUOTA_TOTAL: _ClassVar[Reason]
    REASON_QUOTA_CONCURRENT: _ClassVar[Reason]
    REASON_NO_CAPACITY: _ClassVar[Reason]
    REASON_RATE_LIMIT: _ClassVar[Reason]
    REASON_PHASE_NOT_OPEN: _ClassVar[Reason]
    REASON_PHASE_CLOSED: _ClassVar[Reason]
    REASON_PHASE_PAUSED: _ClassVar[Reason]
    REASON_CLIENT_TOO_OLD: _ClassVar[Reason]
    REASON_CLIENT_TOO_NEW: _ClassVar[Reason]
    REASON_ENCODING_UNSUPPORTED: _ClassVar[Reason]
    REASON_SENSOR_NOT_ALLOWED: _ClassVar[Reason]
    REASON_PHASE_UNKNOWN: _ClassVar[Reason]
    REASON_RUN_UNKNOWN: _ClassVar[Reason]
    REASON_SLOT_UNKNOWN: _ClassVar[Reason]
    REASON_EPISODE_UNKNOWN: _ClassVar[Reason]
    REASON_ACTION_OUT_OF_RANGE: _ClassVar[Reason]
    REASON_BAD_REQUEST: _ClassVar[Reason]
    REASON_STEP_AHEAD: _ClassVar[Reason]
    REASON_STEP_CONFLICT: _ClassVar[Reason]
    REASON_EPISODE_OVER: _ClassVar[Reason]
    REASON_RUN_OVER: _ClassVar[Reason]
    REASON_SUPERSEDED: _ClassVar[Reason]
    REASON_DRAINING: _ClassVar[Reason]
    REASON_SIM_FAULT: _ClassVar[Reason]
    REASON_INTERNAL: _ClassVar[Reason]
    REASON_UNSUPPORTED: _ClassVar[Reason]
    REASON_TOO_SLOW: _ClassVar[Reason]
    REASON_SLOT_BUSY: _ClassVar[Reason]
    REASON_TOKEN_SCOPE: _ClassVar[Reason]
ORDER_UNSPECIFIED: Order
ORDER_ORDERED: Order
ORDER_UNORDERED: Order
ACTION_UNSPECIFIED: Action
ACTION_MOVE_FORWARD: Action
ACTION_TURN_LEFT: Action
ACTION_TURN_RIGHT: Action
ACTION_SUBMIT: Action
ACTION_STOP: Action
END_REASON_UNSPECIFIED: EndReason
END_REASON_STOPPED: EndReason
END_REASON_FINAL_SUBMIT: EndReason
END_REASON_STEP_LIMIT: EndReason
END_REASON_TIME_BUDGET: EndReason
END_REASON_ABANDONED: EndReason
END_REASON_DISCONNECTED: EndReason
END_REASON_SERVER_FAULT: EndReason
SENSOR_KIND_UNSPECIFIED: SensorKind
SENSOR_KIND_RGB: SensorKind
SENSOR_KIND_DEPTH: SensorKind
SENSOR_KIND_AUDIO: SensorKind
DTYPE_UNSPECIFIED: Dtype
DTYPE_U8: Dtype
DTYPE_U16: Dtype
DTYPE_I16: Dtype
DTYPE_F32: Dtype
ENCODING_UNSPECIFIED: Encoding
ENCODING_RAW: Encoding
ENCODING_PNG: Encoding
ENCODING_QOI: Encoding
ENCODING_DEPTH_U16_MM: Encoding
ENCODING_AUDIO_I16: Encoding
ENCODING_PACKED: Encoding
ENCODING_DEPTH_U16_MM_PACKED: Encoding
REASON_UNSPECIFIED: Reason
REASON_TOKEN_MISSING: Reason
REASON_TOKEN_MALFORMED: Reason
REASON_TOKEN_EXPIRED: Reason
REASON_TOKEN_REVOKED: Reason
REASON_TEAM_NOT_APPROVED: Reason
REASON_PHASE_NOT_VISIBLE: Reason
REASON_QUOTA_DAY: Reason
REASON_QUOTA_MONTH: Reason
REASON_QUOTA_TOTAL: Reason
REASON_QUOTA_CONCURRENT: Reason
REASON_NO_CAPACITY: Reason
REASON_RATE_LIMIT: Reason
REASON_PHASE_NOT_OPEN: Reason
REASON_PHASE_CLOSED: Reason
REASON_PHASE_PAUSED: Reason
REASON_CLIENT_TOO_OLD: Reason
REASON_CLIENT_TOO_NEW: Reason
REASON_ENCODING_UNSUPPORTED: Reason
REASON_SENSOR_NOT_ALLOWED: Reason
REASON_PHASE_UNKNOWN: Reason
REASON_RUN_UNKNOWN: Reason
REASON_SLOT_UNKNOWN: Reason
REASON_EPISODE_UNKNOWN: Reason
REASON_ACTION_OUT_OF_RANGE: Reason
REASON_BAD_REQUEST: Reason
REASON_STEP_AHEAD: Reason
REASON_STEP_CONFLICT: Reason
REASON_EPISODE_OVER: Reason
REASON_RUN_OVER: Reason
REASON_SUPERSEDED: Reason
REASON_DRAINING: Reason
REASON_SIM_FAULT: Reason
REASON_INTERNAL: Reason
REASON_UNSUPPORTED: Reason
REASON_TOO_SLOW: Reason
REASON_SLOT_BUSY: Reason
REASON_TOKEN_SCOPE: Reason

class Tensor(_message.Message):
    __slots__ = ("id", "dtype", "shape", "encoding", "data")
    ID_FIELD_NUMBER: _ClassVar[int]
    DTYPE_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    id: int
    dtype: Dtype
    shape: _containers.RepeatedScalarFieldContainer[int]
    encoding: Encoding
    data: bytes
    def __init__(self, id: _Optional[int] = ..., dtype: _Optional[_Union[Dtype, str]] = ..., shape: _Optional[_Iterable[int]] = ..., encoding: _Optional[_Union[Encoding, str]] = ..., data: _Optional[bytes] = ...) -> None: ...

class Pose(_message.Message):
    __slots__ = ("x_m", "y_m", "z_m", "heading_rad")
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    Z_M_FIELD_NUMBER: _ClassVar[int]
    HEADING_RAD_FIELD_NUMBER: _ClassVar[int]
    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    def __init__(self, x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., z_m: _Optional[float] = ..., heading_rad: _Optional[float] = ...) -> None: ...

class ClientInfo(_message.Message):
    __slots__ = ("name", "version", "api_minor")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    API_MINOR_FIELD_NUMBER: _ClassVar[int]
    name: str
    version: str
    api_minor: int
    def __init__(self, name: _Optional[str] = ..., version: _Optional[str] = ..., api_minor: _Optional[int] = ...) -> None: ...

class Digests(_message.Message):
    __slots__ = ("engine", "dataset", "scorer", "config")
    ENGINE_FIELD_NUMBER: _ClassVar[int]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    SCORER_FIELD_NUMBER: _ClassVar[int]
    CONFIG_FIELD_NUMBER: _ClassVar[int]
    engine: str
    dataset: str
    scorer: str
    config: str
    def __init__(self, engine: _Optional[str] = ..., dataset: _Optional[str] = ..., scorer: _Optional[str] = ..., config: _Optional[str] = ...) -> None: ...

class TimeLimits(_message.Message):
    __slots__ = ("step_ms", "bank_ms", "run_s", "disconnect_s", "disconnect_total_s")
    STEP_MS_FIELD_NUMBER: _ClassVar[int]
    BANK_MS_FIELD_NUMBER: _ClassVar[int]
    RUN_S_FIELD_NUMBER: _ClassVar[int]
    DISCONNECT_S_FIELD_NUMBER: _ClassVar[int]
    DISCONNECT_TOTAL_S_FIELD_NUMBER: _ClassVar[int]
    step_ms: int
    bank_ms: int
    run_s: int
    disconnect_s: int
    disconnect_total_s: int
    def __init__(self, step_ms: _Optional[int] = ..., bank_ms: _Optional[int] = ..., run_s: _Optional[int] = ..., disconnect_s: _Optional[int] = ..., disconnect_total_s: _Optional[int] = ...) -> None: ...

class Metric(_message.Message):
    __slots__ = ("name", "value", "low", "high", "n")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    LOW_FIELD_NUMBER: _ClassVar[int]
    HIGH_FIELD_NUMBER: _ClassVar[int]
    N_FIELD_NUMBER: _ClassVar[int]
    name: str
    value: float
    low: float
    high: float
    n: int
    def __init__(self, name: _Optional[str] = ..., value: _Optional[float] = ..., low: _Optional[float] = ..., high: _Optional[float] = ..., n: _Optional[int] = ...) -> None: ...

class PublicMetrics(_message.Message):
    __slots__ = ("metrics",)
    METRICS_FIELD_NUMBER: _ClassVar[int]
    metrics: _containers.RepeatedCompositeFieldContainer[Metric]
    def __init__(self, metrics: _Optional[_Iterable[_Union[Metric, _Mapping]]] = ...) -> None: ...

class RunProgress(_message.Message):
    __slots__ = ("total", "done", "in_flight", "eta_s")
    TOTAL_FIELD_NUMBER: _ClassVar[int]
    DONE_FIELD_NUMBER: _ClassVar[int]
    IN_FLIGHT_FIELD_NUMBER: _ClassVar[int]
    ETA_S_FIELD_NUMBER: _ClassVar[int]
    total: int
    done: int
    in_flight: int
    eta_s: int
    def __init__(self, total: _Optional[int] = ..., done: _Optional[int] = ..., in_flight: _Optional[int] = ..., eta_s: _Optional[int] = ...) -> None: ...
