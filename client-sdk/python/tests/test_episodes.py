"""Tests of whole episodes: frames, observations, agents on slots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from server import PHASE

import avln
from avln.v1 import common_pb2, play_pb2

if TYPE_CHECKING:
    from conftest import Endpoint

SMALL = avln.Sensors.square(64)


def begin(
    endpoint: Endpoint, method: str, sensors: avln.Sensors = SMALL, connect_options: avln.ConnectOptions | None = None
) -> avln.Play:
    return avln.begin(endpoint.url, endpoint.token, PHASE, method, sensors=sensors, connect_options=connect_options)


def test_client_reads_server_phases_and_account(client: avln.Client) -> None:
    assert not client.server_info().draining
    assert client.whoami().team == "Python"
    phase = next(phase for phase in client.phases() if phase.id == PHASE)
    assert (phase.state, phase.episodes, phase.max_slots) == ("open", 3, 4)
    assert avln.Order.ORDERED in phase.orders
    concurrent = [quota.window for quota in client.quota(PHASE)]
    assert all(isinstance(window, str) for window in concurrent)


def test_run_plays_all_episodes(endpoint: Endpoint, client: avln.Client) -> None:
    with begin(endpoint, "two loops") as run:
        played = 0
        for episode in run:
            assert 2 <= len(episode.mission.goals) <= 4
            for observation in episode:
                last = observation.step == 6
                episode.act(avln.Action.STOP if last else avln.Action.TURN_LEFT)
            assert episode.end is not None
            assert (episode.end.reason, episode.end.steps) == (avln.EndReason.STOPPED, 7)
            assert episode.end.terminated
            played += 1
        assert played == 3
    assert run.summary is not None
    assert run.summary.complete
    assert run.summary.ends == [(avln.EndReason.STOPPED, 3)]
    assert run.summary.metric("isr") is not None
    assert client.run(run.run).state == "completed"
    assert run.run in [status.id for status in client.runs(PHASE)]


def test_observation_arrays_have_documented_shapes_and_units(endpoint: Endpoint) -> None:
    with begin(endpoint, "arrays") as run:
        episode = run.next_episode()
        assert episode is not None
        seen = episode.observation
        assert seen.pose == avln.Pose()
        assert seen.rgb is not None
        assert seen.depth is not None
        assert seen.audio is not None
        assert (seen.rgb.shape, seen.rgb.dtype.name) == ((64, 64, 3), "uint8")
        assert (seen.depth.shape, seen.depth.dtype.name) == ((64, 64), "float32")
        assert (seen.audio.shape, seen.audio.dtype.name) == ((2, run.task.audio_samples), "float32")
        assert seen.depth.min() >= 0
        assert 0 < seen.depth.max() <= run.task.depth_max_m
        assert not seen.rgb.flags.owndata
        turned = episode.act(avln.Action.TURN_LEFT)
        assert turned.pose.heading_rad == pytest.approx(run.task.turn_rad, abs=1e-6)
        assert (turned.step, turned.remaining_steps) == (1, run.task.max_steps - 1)


def test_unrequested_sensors_are_none(endpoint: Endpoint) -> None:
    with begin(endpoint, "blind", avln.Sensors(rgb=False, depth=False, audio=False)) as run:
        episode = run.next_episode()
        assert episode is not None
        seen = episode.act(avln.Action.MOVE_FORWARD)
        assert (seen.rgb, seen.depth, seen.audio) == (None, None, None)


def senses(endpoint: Endpoint, packing: avln.Packing) -> list[avln.Observation]:
    with begin(endpoint, packing.value, connect_options=avln.ConnectOptions(packing=packing)) as run:
        episode = run.next_episode()
        assert episode is not None
        moves = [avln.Action.TURN_LEFT, avln.Action.MOVE_FORWARD, avln.Action.MOVE_FORWARD]
        return [episode.observation, *(episode.act(move) for move in moves)]


def test_lossless_observations_equal_raw(endpoint: Endpoint) -> None:
    raw = senses(endpoint, avln.Packing.RAW)
    for one, other in zip(raw, senses(endpoint, avln.Packing.LOSSLESS)):
        np.testing.assert_array_equal(one.rgb, other.rgb)
        np.testing.assert_array_equal(one.depth, other.depth)
        np.testing.assert_array_equal(one.audio, other.audio)
        assert one.pose == other.pose


def test_rounded_observations_are_close_to_raw(endpoint: Endpoint) -> None:
    for one, other in zip(senses(endpoint, avln.Packing.RAW), senses(endpoint, avln.Packing.ROUNDED)):
        assert one.depth is not None
        assert other.depth is not None
        np.testing.assert_array_equal(one.rgb, other.rgb)
        np.testing.assert_allclose(one.depth, other.depth, atol=0.51e-3)


def test_goals_have_either_text_or_image(endpoint: Endpoint) -> None:
    with begin(endpoint, "goals") as run:
        goals = [goal for episode in run for goal in episode.mission.goals]
    for goal in goals:
        is_picture = goal.modality is avln.Modality.IMAGE
        assert (goal.image is not None) == is_picture
        assert bool(goal.text) != is_picture
        assert goal.image is None or (goal.image.dtype == np.uint8 and goal.image.ndim == 3)


def test_invalid_actions_raise_and_cost_no_step(endpoint: Endpoint) -> None:
    with begin(endpoint, "wrong") as run:
        episode = run.next_episode()
        assert episode is not None
        with pytest.raises(avln.UnknownActionError, match=r"invalid action 7.*Action.STOP \(4\)"):
            episode.act(7)  # type: ignore[arg-type]
        assert episode.observation.step == 0
        with pytest.raises(avln.Error, match="no action was taken"):
            list(episode)
        episode.act(avln.Action.STOP)
        assert episode.is_over
        with pytest.raises(avln.EpisodeOverError):
            episode.act(avln.Action.STOP)


def test_next_episode_abandons_open_episode(endpoint: Endpoint) -> None:
    with begin(endpoint, "abandon") as run:
        first = run.next_episode()
        assert first is not None
        second = run.next_episode()
        assert second is not None
        assert second.ordinal == 2
        assert first.end is not None
        assert first.end.reason is avln.EndReason.ABANDONED


def test_exception_leaves_run_open(endpoint: Endpoint, client: avln.Client) -> None:
    run = client.start_run(PHASE, "comes back")

    def crash() -> None:
        with client.play(run, SMALL) as play:
            assert play.next_episode() is not None
            raise RuntimeError("policy")

    with pytest.raises(RuntimeError, match="policy"):
        crash()
    assert not client.run(run.id).is_over
    with avln.begin(endpoint.url, run.token, "", "", sensors=SMALL) as play:
        assert play.run == run.id
        assert play.next_episode() is not None


def test_refusals_contain_server_reason(endpoint: Endpoint, client: avln.Client) -> None:
    with pytest.raises(avln.RefusedError, match="PHASE_UNKNOWN") as refused:
        client.start_run("no-such-phase", "method")
    assert refused.value.reason == "PHASE_UNKNOWN"
    with pytest.raises(avln.TokenError, match="AVLN_TOKEN"):
        avln.connect(endpoint.url, "avln_nobody")
    with pytest.raises(avln.SensorsError, match="63 x 63"):
        client.play(client.start_run(PHASE, "tiny"), avln.Sensors.square(63))


def test_raw_connection_sends_and_receives_frames(client: avln.Client) -> None:
    connection, agreement = client.connection(client.start_run(PHASE, "frames"), 2, SMALL)
    for slot in range(agreement.slots):
        connection.send(play_pb2.Ready(slot=slot))
    starts = [connection.next(slot, timeout_s=30) for slot in range(agreement.slots)]
    assert [type(start) for start in starts] == [play_pb2.EpisodeStart] * 2
    start = starts[1]
    assert isinstance(start, play_pb2.EpisodeStart)
    connection.send(play_pb2.Act(slot=1, episode=start.episode, step=1, action=common_pb2.ACTION_STOP))
    assert isinstance(connection.next(1, timeout_s=30), play_pb2.Observation)
    assert isinstance(connection.next(1, timeout_s=30), play_pb2.EpisodeEnd)
    connection.send(play_pb2.Goodbye())
    assert isinstance(connection.next(1, timeout_s=30), play_pb2.RunEnd)
    assert isinstance(connection.next(1, timeout_s=30), avln.Closed)
    connection.close()


class Turner:
    """An agent that turns for some steps and stops."""

    def begin(self, _task: avln.TaskSpec, _mission: avln.Mission) -> None:
        self.steps = 0

    def act(self, _observation: avln.Observation) -> avln.Action:
        self.steps += 1
        return avln.Action.STOP if self.steps == 5 else avln.Action.TURN_RIGHT


def test_agents_play_slots_in_parallel(client: avln.Client) -> None:
    ends: list[avln.EpisodeEnd] = []
    run = client.start_run(PHASE, "slots")
    summary = avln.evaluate_slots(client, run, [Turner(), Turner()], SMALL, ends.append)
    assert summary.complete
    assert sorted(end.steps for end in ends) == [5, 5, 5]


class Failing(Turner):
    """An agent that raises an exception after some steps."""

    def act(self, observation: avln.Observation) -> avln.Action:
        if observation.step == 2:
            raise RuntimeError("out of memory")
        return avln.Action.TURN_LEFT


def test_failing_agent_leaves_run_open(client: avln.Client) -> None:
    run = client.start_run(PHASE, "fails")
    with pytest.raises(RuntimeError, match="out of memory"):
        avln.evaluate_slots(client, run, [Failing(), Failing()], SMALL)
    assert not client.run(run.id).is_over
    assert client.cancel_run(run.id).state == "cancelled"


def test_watch_yields_states_until_run_ends(client: avln.Client) -> None:
    run = client.start_run(PHASE, "watched")
    states = client.watch(run.id)
    assert next(states).state == "created"
    client.cancel_run(run.id)
    assert [status.state for status in states][-1] == "cancelled"
