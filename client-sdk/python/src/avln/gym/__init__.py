"""Episodes as Gymnasium environments; `pip install 'avln[gym]'`.

`import avln` registers `"avln/LHAVLN-v1"` if Gymnasium is installed, for
`gymnasium.make("avln/LHAVLN-v1", server=…, token=…)` and for `gymnasium.make_vec` with
`vectorization_mode="vector_entry_point"`, which plays several slots of a run in parallel.
"""

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("avln.gym needs gymnasium; pip install 'avln[gym]'", name=error.name) from None

from avln.gym.env import LHAVLNEnv, Reward
from avln.gym.spaces import GOAL_TEXT_BYTES, MAX_GOALS, ObservationSpace
from avln.gym.vector import LHAVLNVectorEnv

ENV_ID = "avln/LHAVLN-v1"
"""Registered environment name."""

TRAINING_ENV_ID = "avln/LHAVLNTrain-v1"
"""Registered name of the training environments, `avln.sim`."""

if TRAINING_ENV_ID not in gymnasium.registry:
    gymnasium.register(
        TRAINING_ENV_ID,
        entry_point="avln.sim.env:Env",
        vector_entry_point="avln.sim.vector:VectorEnv",
        disable_env_checker=True,
    )

if ENV_ID not in gymnasium.registry:
    gymnasium.register(
        ENV_ID,
        entry_point="avln.gym.env:LHAVLNEnv",
        vector_entry_point="avln.gym.vector:LHAVLNVectorEnv",
        disable_env_checker=True,
    )

__all__ = [
    "ENV_ID",
    "GOAL_TEXT_BYTES",
    "MAX_GOALS",
    "TRAINING_ENV_ID",
    "LHAVLNEnv",
    "LHAVLNVectorEnv",
    "ObservationSpace",
    "Reward",
]
