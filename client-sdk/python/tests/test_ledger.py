"""What is sent again when a connection is lost."""

from __future__ import annotations

from avln.ledger import Ledger, Sent
from avln.v1 import common_pb2, play_pb2


def act(step: int) -> Sent:
    return play_pb2.Act(slot=0, episode="ep_a", step=step, action=common_pb2.ACTION_STOP)


def seen(step: int) -> play_pb2.Observation:
    return play_pb2.Observation(episode="ep_a", step=step)


def at(step: int) -> list[play_pb2.SlotPosition]:
    return [play_pb2.SlotPosition(slot=0, episode="ep_a", step=step)]


def begun() -> Ledger:
    ledger = Ledger(2)
    ledger.arrived(play_pb2.EpisodeStart(episode="ep_a", observation=seen(0)))
    return ledger


def test_an_action_is_sent_again_where_the_server_did_not_take_it() -> None:
    ledger = begun()
    ledger.sending(act(1))
    assert ledger.to_repeat(at(0)) == [act(1)]
    assert ledger.to_repeat(at(1)) == [], "its result is on its way"
    assert ledger.to_repeat([]) == [], "the episode is over, and its end on its way"
    assert ledger.arrived(seen(1))
    assert ledger.to_repeat(at(1)) == []
    assert ledger.known() == at(1)


def test_what_arrived_before_is_told_from_what_is_new() -> None:
    ledger = begun()
    assert not ledger.arrived(seen(0))
    assert ledger.arrived(seen(1))
    assert not ledger.arrived(seen(1))


def test_ready_is_sent_again_where_no_episode_began() -> None:
    ready = play_pb2.Ready(slot=1)
    ledger = begun()
    ledger.sending(ready)
    assert ledger.to_repeat(at(0)) == [ready]
    both = [*at(0), play_pb2.SlotPosition(slot=1, episode="ep_b", step=0)]
    assert ledger.to_repeat(both) == []


def test_a_refused_action_is_not_sent_again_and_an_end_frees_the_slot() -> None:
    ledger = begun()
    ledger.sending(act(1))
    ledger.arrived(play_pb2.Fault(slot=0, episode="ep_a", recoverable=True))
    assert ledger.to_repeat(at(0)) == []
    gone = play_pb2.Fault(slot=0, episode="ep_a", reason=common_pb2.REASON_EPISODE_UNKNOWN)
    assert ledger.is_gone(gone)
    ledger.arrived(play_pb2.EpisodeEnd(slot=0, episode="ep_a"))
    assert ledger.known() == []
    assert not ledger.is_gone(gone)
    ledger.arrived(play_pb2.RunEnd())
    assert ledger.is_over
