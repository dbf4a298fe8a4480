"""Python client of LH-AVLN Arena: connection, episodes, Gymnasium.

Start with `Client`, `Play` and `Episode`:

    import avln

    with avln.begin("http://127.0.0.1:50051", token, "", "my-method") as run:
        for episode in run:
            for observation in episode:
                episode.act(avln.Action.MOVE_FORWARD)

`avln.gym` contains Gymnasium environments, `avln.habitat` plays Habitat agents, and
`avln.bridge` serves clients of the authors' protocol.

The package contains no targets, positions or scores that the server hides.
"""

from contextlib import suppress

from avln.action import Action, EndReason, Order
from avln.agent import Agent, evaluate, evaluate_slots
from avln.client import Client, begin, begin_run, connect
from avln.connect_options import ConnectOptions
from avln.connection import Closed, Connection
from avln.errors import (
    AddressError,
    EpisodeOverError,
    Error,
    LostError,
    NotArenaError,
    PhaseError,
    ProtocolError,
    RefusedError,
    RunOverError,
    SensorsError,
    TlsError,
    TokenError,
    UnknownActionError,
    UnreachableError,
)
from avln.method_type import MethodType
from avln.mission import Goal, Mission, Modality
from avln.observation import Feedback, Observation, Pose
from avln.packing import Packing
from avln.play import Episode, Play, TimeLeft
from avln.service import Account, Phase, Quota, Run, RunStatus, ServerInfo
from avln.summary import EpisodeEnd, Metric, Notice, Progress, RunSummary
from avln.task import Sensors, TaskSpec
from avln.version import VERSION

with suppress(ImportError):  # Gymnasium is optional
    from avln import gym as gym

__version__ = VERSION

__all__ = [
    "Account",
    "Action",
    "AddressError",
    "Agent",
    "Client",
    "Closed",
    "ConnectOptions",
    "Connection",
    "EndReason",
    "Episode",
    "EpisodeEnd",
    "EpisodeOverError",
    "Error",
    "Feedback",
    "Goal",
    "LostError",
    "MethodType",
    "Metric",
    "Mission",
    "Modality",
    "NotArenaError",
    "Notice",
    "Observation",
    "Order",
    "Packing",
    "Phase",
    "PhaseError",
    "Play",
    "Pose",
    "Progress",
    "ProtocolError",
    "Quota",
    "RefusedError",
    "Run",
    "RunOverError",
    "RunStatus",
    "RunSummary",
    "Sensors",
    "SensorsError",
    "ServerInfo",
    "TaskSpec",
    "TimeLeft",
    "TlsError",
    "TokenError",
    "UnknownActionError",
    "UnreachableError",
    "__version__",
    "begin",
    "begin_run",
    "connect",
    "evaluate",
    "evaluate_slots",
]
