"""Tests of Habitat and SoundSpaces observations, with values calculated by hand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from server import PHASE

import avln
from avln import habitat
from avln.habitat import EVALUATION_ACTIONS, TRAINING_ACTIONS, Senses, to_action
from avln.spectrogram import spectrogram

if TYPE_CHECKING:
    from conftest import Endpoint

TASK = avln.TaskSpec()
GOALS = avln.Mission(
    avln.Order.ORDERED,
    [
        avln.Goal(avln.Modality.CATEGORY, text="bed"),
        avln.Goal(avln.Modality.DESCRIPTION, text="the red lamp"),
        avln.Goal(avln.Modality.IMAGE, image=np.zeros((2, 2, 3), np.uint8)),
    ],
)


def sense(key: str, seen: avln.Observation, start: avln.Pose | None = None, **more: Any) -> Any:
    return Senses(TASK, (key,), **more).observations(seen, start or avln.Pose(), GOALS)[key]


def at(x_m: float, z_m: float, heading_deg: float) -> avln.Observation:
    return avln.Observation(step=7, pose=avln.Pose(x_m, 0.1, z_m, math.radians(heading_deg)))


def test_depth_is_normalized_between_limits() -> None:
    depth = np.array([[0.0, 0.5, 1.0, 5.0, 7.0]], np.float32)
    seen = avln.Observation(depth=depth)
    plain = sense("depth", seen)
    assert plain.shape == (1, 5, 1)
    np.testing.assert_allclose(plain[0, :, 0], [1.0, 0.05, 0.1, 0.5, 0.7])
    near = sense("depth", seen, min_depth_m=0.5, max_depth_m=5.0)
    np.testing.assert_allclose(near[0, :, 0], [1.0, 0.0, 0.5 / 4.5, 1.0, 1.0], rtol=1e-6)
    metres = sense("depth", seen, min_depth_m=0.5, max_depth_m=5.0, normalize_depth=False)
    np.testing.assert_allclose(metres[0, :, 0], [5.0, 0.5, 1.0, 5.0, 5.0])


def test_gps_is_forward_and_right_of_start() -> None:
    # Two metres ahead (-Z) and half a metre to the right (+X) of a start that faces -Z.
    np.testing.assert_allclose(sense("gps", at(0.5, -2.0, 0)), [2.0, 0.5])


def test_gps_and_compass_are_relative_to_start() -> None:
    # A start at (10, 20) that faces -X. Three metres towards -X are 3 ahead; a metre towards -Z is 1 to the right.
    start = avln.Pose(10.0, 0.0, 20.0, math.pi / 2)
    seen = at(7.0, 19.0, 120)
    np.testing.assert_allclose(sense("gps", seen, start), [3.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(sense("compass", seen, start), [math.radians(30)], atol=1e-6)
    np.testing.assert_allclose(sense("pose", seen, start), [3.0, 1.0, math.radians(30), 7.0], atol=1e-6)


def test_compass_wraps_at_pi() -> None:
    start = avln.Pose(heading_rad=math.radians(-170))
    np.testing.assert_allclose(sense("compass", at(0, 0, 170), start), [math.radians(-20)], atol=1e-6)


def test_full_pose_is_position_and_quaternion() -> None:
    half = math.sqrt(0.5)
    np.testing.assert_allclose(
        sense("full_pose_sensor", at(1.0, 2.0, 90)), [1.0, 0.1, 2.0, 0.0, half, 0.0, half], atol=1e-6
    )


def test_audiogoal_is_padded_to_one_second() -> None:
    audio = np.ones((2, 4000), np.float32)
    audio[1] = 0.5
    filled = sense("audiogoal", avln.Observation(audio=audio))
    assert filled.shape == (2, 16000)
    assert filled[:, :4000].mean(axis=1).tolist() == [1.0, 0.5]
    assert not filled[:, 4000:].any()
    assert sense("audiogoal", avln.Observation(audio=audio), audio_samples=2000).shape == (2, 2000)


def test_click_spectrogram_matches_hand_calculation() -> None:
    """A click at sample 8000, the middle of frame 50.

    The magnitude of a click is the window value at its sample, for all frequencies: 1 in frame 50, and 160 samples
    from the middle, in frames 49 and 51, 0.5 + 0.5 cos(144 degrees) = 0.0954915; other frames do not contain it.
    Frames 48 to 51 are a block: (0.0954915 + 1 + 0.0954915) / 4 = 0.2977457, log(1.2977457) = 0.2606288. The last
    block contains the last of 257 frequencies and three zeros: log(1 + 0.2977457 / 4) = 0.0717963.
    """
    audio = np.zeros((2, 16000), np.float32)
    audio[0, 8000] = 1.0
    seen = spectrogram(audio)
    assert (seen.shape, seen.dtype.name) == ((65, 26, 2), "float32")
    np.testing.assert_allclose(seen[:64, 12, 0], 0.2606288, rtol=1e-5)
    np.testing.assert_allclose(seen[64, 12, 0], 0.0717963, rtol=1e-5)
    assert not seen[..., 1].any()
    assert not np.delete(seen[..., 0], 12, axis=1).any()


def test_spectrogram_padding_is_selectable() -> None:
    """A click at sample 80: frames 0 and 1 contain it, and frame 0 also the mirrored click at -80.

    The click is 80 samples from the middle of both frames: the window value is 0.5 + 0.5 cos(72 degrees) = 0.6545085.
    """
    audio = np.zeros((2, 16000), np.float32)
    audio[:, 80] = 1.0
    w = 0.6545085
    far = 0.0  # 240 samples away
    constant = spectrogram(audio, "constant")[:64, 0, 0]
    np.testing.assert_allclose(constant, np.log1p((2 * w + far) / 4), rtol=1e-5)
    # The sum of both clicks in frame 0 is 2w |cos(80 · 2 pi k / 512)|; the first block contains k = 0 to 3.
    mirrored = spectrogram(audio, "reflect")[0, 0, 0]
    frame_0 = np.mean([2 * w * abs(math.cos(80 * 2 * math.pi * k / 512)) for k in range(4)])
    np.testing.assert_allclose(mirrored, np.log1p((frame_0 + w) / 4), rtol=1e-5)


def test_goals_have_authors_format() -> None:
    goals = sense("goals", avln.Observation())
    assert goals[0] == {"modality": "object", "category": "bed"}
    assert goals[1] == {"modality": "description", "text": "the red lamp"}
    assert goals[2]["modality"] == "image"
    assert goals[2]["image"].shape == (2, 2, 3)


def test_errors_name_unknown_keys_and_missing_sensors() -> None:
    with pytest.raises(ValueError, match=r"unknown keys \['semantic'\]"):
        Senses(TASK, ("rgb", "semantic"))
    with pytest.raises(ValueError, match="has no audio"):
        sense("spectrogram", avln.Observation())


@pytest.mark.parametrize(
    ("choice", "action"),
    [
        (0, avln.Action.STOP),
        (np.int64(1), avln.Action.MOVE_FORWARD),
        ({"action": 2}, avln.Action.TURN_LEFT),
        ({"action": "TURN_RIGHT"}, avln.Action.TURN_RIGHT),
        ("lifelong_submit", avln.Action.SUBMIT),
        ("move_forward", avln.Action.MOVE_FORWARD),
    ],
)
def test_choices_become_actions(choice: Any, action: avln.Action) -> None:
    assert to_action(choice) is action


def test_action_orders_differ_and_unknown_choices_fail() -> None:
    assert [to_action(number, TRAINING_ACTIONS).name for number in range(3)] == ["STOP", "SUBMIT", "MOVE_FORWARD"]
    assert [to_action(number).name for number in range(5)] == [action.name for action in EVALUATION_ACTIONS]
    for choice in (5, -1, "look_up", None, {"action": 9}, float("inf"), float("nan")):
        with pytest.raises(avln.UnknownActionError, match="0 STOP"):
            to_action(choice)


class FakeHabitatAgent:
    """A `habitat.Agent` that checks all observations."""

    def __init__(self, keys: list[str]) -> None:
        self.keys, self.resets = keys, 0

    def reset(self) -> None:
        self.resets += 1
        self.acts = 0

    def act(self, observations: dict[str, Any]) -> dict[str, Any]:
        assert list(observations) == self.keys
        assert all(np.isfinite(value).all() for key, value in observations.items() if key != "goals")
        assert 0 <= observations["depth"].min() <= observations["depth"].max() <= 1
        self.acts += 1
        return {"action": "STOP" if self.acts % 3 == 0 else "TURN_LEFT", "action_args": None}


@pytest.mark.parametrize("stop_submits", [False, True])
def test_unmodified_habitat_agent_plays_run(endpoint: Endpoint, *, stop_submits: bool) -> None:
    keys = ["rgb", "depth", "audiogoal", "spectrogram", "gps", "compass", "pose", "full_pose_sensor", "goals"]
    agent, ends = FakeHabitatAgent(keys), list[avln.EpisodeEnd]()
    with avln.begin(endpoint.url, endpoint.token, PHASE, "habitat", sensors=avln.Sensors.square(64)) as run:
        habitat.play(run, agent, keys=keys, stop_submits=stop_submits, on_end=ends.append)
    assert agent.resets == len(ends) == 3
    assert {end.reason for end in ends} == {avln.EndReason.STOPPED}
    assert all(end.steps == 3 for end in ends) or stop_submits
