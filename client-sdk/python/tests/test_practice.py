"""Tests of the default phase of runs."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from server import PHASE

import avln
from avln.service import phase_to_practise
from avln.v1 import info_pb2, run_pb2

if TYPE_CHECKING:
    from conftest import Endpoint

OPEN, CLOSED = info_pb2.PHASE_STATE_OPEN, info_pb2.PHASE_STATE_CLOSED


def phase(name: str, state: info_pb2.PhaseState = OPEN) -> avln.Phase:
    return avln.Phase.from_wire(info_pb2.Phase(id=name, state=state))


def quota(name: str, window: run_pb2.QuotaWindow, limit: int) -> avln.Quota:
    return avln.Quota.from_wire(run_pb2.Quota(phase=name, window=window, limit=limit))


PHASES = [phase("val"), phase("test"), phase("practice"), phase("old", CLOSED)]
COUNTED = quota("test", run_pb2.QUOTA_WINDOW_DAY, 5)


def test_default_phase_spends_no_quota() -> None:
    side_by_side = quota("val", run_pb2.QUOTA_WINDOW_CONCURRENT, 2)
    assert phase_to_practise(PHASES[:2], [COUNTED, side_by_side]) == "val"
    assert phase_to_practise(PHASES, [COUNTED]) == "practice"


@pytest.mark.parametrize(
    ("phases", "quotas", "problem"),
    [
        (PHASES[:2], [], "several phases have no quota: val, test; choose a phase with phase= or --phase"),
        (PHASES[1:2] + PHASES[3:], [COUNTED], "no open phase is without a quota; known phases: test, old; choose"),
        ([], [], "no phase for your team"),
    ],
)
def test_ambiguous_phase_error_lists_phases(phases: list[avln.Phase], quotas: list[avln.Quota], problem: str) -> None:
    with pytest.raises(avln.PhaseError, match=re.escape(problem)):
        phase_to_practise(phases, quotas)


def test_run_without_phase_is_practice(endpoint: Endpoint, client: avln.Client) -> None:
    with avln.begin(endpoint.url, endpoint.token, "", "unnamed") as play:
        assert client.run(play.run).phase == PHASE
