"""Training environments in process, without a server.

`Env` and `VectorEnv` run the simulator and the referee of the benchmark on worker threads of this process. They play
houses of the training pool, and accept no validation or test pool and no sealed split. `import avln` registers
`"avln/LHAVLNTrain-v1"` for `gymnasium.make` and `gymnasium.make_vec`.

    import avln.sim

    envs = avln.sim.VectorEnv(num_envs=8, size=64, senses=("depth", "audio"))
    observations, infos = envs.reset(seed=1)
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())

The wheel for Linux contains the native module; the environment variable `AVLN_NATIVE` can name another one
(docs/training.md).
"""

try:
    import gymnasium as _gymnasium  # noqa: F401
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("avln.sim needs gymnasium; pip install gymnasium", name=error.name) from None

from avln.sim.env import Env
from avln.sim.options import Curriculum, Folder, Progress, Scan, SimError
from avln.sim.recording import record
from avln.sim.vector import VectorEnv

__all__ = ["Curriculum", "Env", "Folder", "Progress", "Scan", "SimError", "VectorEnv", "record"]
