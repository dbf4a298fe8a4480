"""An agent that walks towards the sound, around obstacles in the depth image, and submits at loud positions.

python examples/audio_follower.py --token TOKEN
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from shell import main

import avln

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEAD_RADIUS_M = 0.0875
SOUND_M_PER_S = 343.0
MAX_DELAY_S = HEAD_RADIUS_M / SOUND_M_PER_S * (math.pi / 2 + 1)
ROOM_M = 0.5
PATIENCE_STEPS = 20
UPSAMPLING = 8


def delay_s(audio: NDArray[np.float32], sample_rate_hz: int) -> float:
    """Returns the delay at the left ear, seconds: the GCC-PHAT peak within the head's range."""
    samples = audio.shape[1]
    left, right = np.fft.rfft(audio, 2 * samples)
    cross = left * np.conj(right)
    whitened = cross / np.maximum(np.abs(cross), 1e-12)
    correlation = np.fft.irfft(whitened, 2 * samples * UPSAMPLING)
    most = int(MAX_DELAY_S * sample_rate_hz * UPSAMPLING)
    near = np.concatenate([correlation[-most:], correlation[: most + 1]])
    return float(int(near.argmax()) - most) / (sample_rate_hz * UPSAMPLING)


def bearing_rad(audio: NDArray[np.float32], sample_rate_hz: int) -> float:
    """Returns the sound bearing, radians, -pi/2 to pi/2, left positive; rear directions are folded to the front."""
    lead_s = -delay_s(audio, sample_rate_hz)
    # Woodworth: the delay between the ears of a sphere is r / c (angle + sin angle).
    angles = np.linspace(-math.pi / 2, math.pi / 2, 181)
    leads_s = HEAD_RADIUS_M / SOUND_M_PER_S * (angles + np.sin(angles))
    return float(np.interp(lead_s, leads_s, angles))


class AudioFollower:
    """An agent that follows the sound."""

    sensors = avln.Sensors.square(64)

    def begin(self, task: avln.TaskSpec, mission: avln.Mission) -> None:
        """Resets the agent for an episode."""
        self.task = task
        self.loudest = 0.0
        self.steps_since_louder = 0
        self.goals_left = len(mission.goals)

    def act(self, seen: avln.Observation) -> avln.Action:
        """Claims a goal if the sound has not become louder for some steps, the last one with Stop."""
        assert seen.audio is not None
        assert seen.depth is not None
        if seen.remaining_steps == 1:
            return avln.Action.STOP
        self.listen(float(np.sqrt(np.mean(seen.audio**2))))
        if self.steps_since_louder > PATIENCE_STEPS:
            self.loudest, self.steps_since_louder = 0.0, 0
            return avln.Action.SUBMIT if seen.remaining_submits else avln.Action.STOP
        return self.walk(bearing_rad(seen.audio, self.task.sample_rate_hz), seen.depth)

    def listen(self, level: float) -> None:
        """Counts the steps without a louder sound."""
        self.steps_since_louder = 0 if level > self.loudest else self.steps_since_louder + 1
        self.loudest = max(level, self.loudest)

    def walk(self, bearing: float, depth: NDArray[np.float32]) -> avln.Action:
        """Moves towards the bearing, or to the freer side of an obstacle."""
        middle = depth[len(depth) // 3 : 2 * len(depth) // 3]
        room = np.where(middle > 0, middle, self.task.depth_max_m).min(axis=0)
        left, ahead, right = (part.min() for part in np.array_split(room, 3))
        if ahead < ROOM_M:
            return avln.Action.TURN_LEFT if left > right else avln.Action.TURN_RIGHT
        if abs(bearing) > self.task.turn_rad:
            return avln.Action.TURN_LEFT if bearing > 0 else avln.Action.TURN_RIGHT
        return avln.Action.MOVE_FORWARD


if __name__ == "__main__":
    main(AudioFollower)
