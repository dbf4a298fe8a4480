"""Tests of the frames resent after a lost connection."""

from __future__ import annotations

from avln.resend_buffer import ResendBuffer, Sent
from avln.v1 import common_pb2, play_pb2


def act(step: int) -> Sent:
    return play_pb2.Act(slot=0, episode="ep_a", step=step, action=common_pb2.ACTION_STOP)


def seen(step: int) -> play_pb2.Observation:
    return play_pb2.Observation(episode="ep_a", step=step)


def at(step: int) -> list[play_pb2.SlotPosition]:
    return [play_pb2.SlotPosition(slot=0, episode="ep_a", step=step)]


def begun() -> ResendBuffer:
    resend_buffer = ResendBuffer(2)
    resend_buffer.arrived(play_pb2.EpisodeStart(episode="ep_a", observation=seen(0)))
    return resend_buffer


def test_only_untaken_actions_are_resent() -> None:
    resend_buffer = begun()
    resend_buffer.sending(act(1))
    assert resend_buffer.to_repeat(at(0)) == [act(1)]
    assert resend_buffer.to_repeat(at(1)) == [], "the result is on its way"
    assert resend_buffer.to_repeat([]) == [], "the episode is over, and the end is on its way"
    assert resend_buffer.arrived(seen(1))
    assert resend_buffer.to_repeat(at(1)) == []
    assert resend_buffer.known() == at(1)


def test_duplicates_and_new_frames_are_distinguished() -> None:
    resend_buffer = begun()
    assert not resend_buffer.arrived(seen(0))
    assert resend_buffer.arrived(seen(1))
    assert not resend_buffer.arrived(seen(1))


def test_ready_is_resent_without_episode_start() -> None:
    ready = play_pb2.Ready(slot=1)
    resend_buffer = begun()
    resend_buffer.sending(ready)
    assert resend_buffer.to_repeat(at(0)) == [ready]
    both = [*at(0), play_pb2.SlotPosition(slot=1, episode="ep_b", step=0)]
    assert resend_buffer.to_repeat(both) == []


def test_refused_actions_are_not_resent() -> None:
    resend_buffer = begun()
    resend_buffer.sending(act(1))
    resend_buffer.arrived(play_pb2.Fault(slot=0, episode="ep_a", recoverable=True))
    assert resend_buffer.to_repeat(at(0)) == []
    gone = play_pb2.Fault(slot=0, episode="ep_a", reason=common_pb2.REASON_EPISODE_UNKNOWN)
    assert resend_buffer.is_gone(gone)
    resend_buffer.arrived(play_pb2.EpisodeEnd(slot=0, episode="ep_a"))
    assert resend_buffer.known() == []
    assert not resend_buffer.is_gone(gone)
    resend_buffer.arrived(play_pb2.RunEnd())
    assert resend_buffer.is_over
