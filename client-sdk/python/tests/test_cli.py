"""Tests of the command line `avln-py`."""

from __future__ import annotations

import json
import random
import runpy
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from server import CHALLENGE, PHASE

from avln.cli import main
from avln.doctor import quota_check
from avln.player import load_agent
from avln.service import Quota

if TYPE_CHECKING:
    from conftest import Endpoint

AGENT = """
import avln

class Agent:
    sensors = avln.Sensors(rgb=False, depth=False, audio=False)

    def begin(self, task, mission):
        pass

    def act(self, seen):
        return avln.Action.STOP

class Mute:
    pass
"""


class Program:
    """The program with a server's address and a token; a call returns exit code and output."""

    def __init__(self, endpoint: Endpoint, captured: pytest.CaptureFixture[str]) -> None:
        self.captured = captured
        self.connection = ["--server", endpoint.url, "--token", endpoint.token]

    def __call__(self, command: str, *more: Any) -> tuple[int, str]:
        code = main([command, *self.connection, *map(str, more)])
        output = self.captured.readouterr()
        return code, output.out + output.err


@pytest.fixture
def program(endpoint: Endpoint, capsys: pytest.CaptureFixture[str]) -> Program:
    return Program(endpoint, capsys)


def test_commands_print_account_phases_and_quota(program: Program) -> None:
    assert program("whoami") == (0, "team Python, token without a name (participant), no expiry\n")
    code, phases = program("phases")
    assert code == 0
    assert f"{PHASE}: open, 3 episodes, ordered, unordered, lh-avln-v1" in phases
    assert f"{CHALLENGE}, total: " in program("quota", "--phase", CHALLENGE)[1]


def test_agent_from_file_plays_run(program: Program, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(AGENT)
    code, output = program("run", file, "--phase", PHASE, "--slots", 2, "--order", "ordered")
    assert code == 0
    assert "episode 3 of 3: stopped after 1 steps" in output
    assert "3 of 3 episodes, complete; 3 stopped" in output


def test_unknown_agent_error_gives_reason(program: Program, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(AGENT)
    for name, problem in [
        ("nowhere.py", "there is no file nowhere.py"),
        (f"{file}:Walker", "there is no class Walker"),
        (f"{file}:Mute", "class Mute has no method begin or act"),
        ("no_such_module:Agent", "No module named"),
    ]:
        code, output = program("run", name)
        assert code == 1
        assert problem in output
    assert load_agent("random_walk:RandomWalk").__name__ == "RandomWalk"


def test_doctor_passes_healthy_server_and_reports_problems(program: Program) -> None:
    code, output = program("doctor", "--episodes", 1, "--steps", 5, "--size", 64)
    assert code == 0
    assert f"phase: {PHASE}: 3 episodes" in output
    assert "5 steps, no errors" in output
    assert "ok       run time: at most" in output
    code, output = program("doctor", "--phase", CHALLENGE, "--json")
    checks = {check["name"]: check for check in json.loads(output)["checks"]}
    assert code == 0
    assert checks["practice"]["verdict"] == "warning"
    assert "--practice" in checks["practice"]["next"]
    code, output = program("doctor", "--phase", "no-such-phase", "--practice", PHASE, "--episodes", 1, "--steps", 2)
    assert code == 6
    assert "there is no phase 'no-such-phase'" in output


def quota(window: str, remaining: int | None, limit: int | None) -> Quota:
    refilled_unix_s = 86_400 if window == "day" else 0
    return Quota("finals", window, limit, 0, remaining, refilled_unix_s, [])


def test_doctor_lists_every_limited_window() -> None:
    windows = [quota("total", 3, 3), quota("month", None, None), quota("day", 1, 2), quota("concurrent", 1, 1)]
    check = quota_check(windows)
    assert check.verdict == "ok"
    assert check.found == "runs left: 1 of 2 today (UTC), 3 of 3 in all, 1 of 1 at the same time"
    assert quota_check(windows[1:2]).found == "unlimited runs"


def test_doctor_advice_fits_used_up_window() -> None:
    total, day, concurrent = quota("total", 0, 1), quota("day", 0, 1), quota("concurrent", 0, 1)
    for windows, advice in [
        ([concurrent, quota("day", 1, 2)], "finish or cancel the open run"),
        ([concurrent, day], "wait until 1970-01-02T00:00:00Z"),
        ([total, day, concurrent], "ask the organiser for more runs"),
    ]:
        check = quota_check(windows)
        assert (check.verdict, check.next) == ("failure", advice)


def test_doctor_plays_several_episodes_and_cancels_run(program: Program, endpoint: Endpoint) -> None:
    code, output = program("doctor", "--phase", PHASE, "--episodes", 2, "--steps", 4, "--size", 64)
    assert (code, "8 steps, no errors" in output) == (0, True), output
    with endpoint.connect() as client:
        runs = [run for run in client.runs(PHASE) if run.method == "avln-py doctor"]
    assert runs
    assert all(run.state == "cancelled" for run in runs), runs


def test_doctor_does_not_play_only_episode(program: Program, endpoint: Endpoint) -> None:
    endpoint.server.command("data", "split", "make", "single", "--houses", "1", "--missions", "1")
    endpoint.server.command("challenge", "phase", "open", "single", "--split", "single")
    code, output = program("doctor", "--phase", "single")
    assert (code, "'single', whose only episode would complete a run" in output) == (0, True), output


def test_doctor_warns_before_token_expires(program: Program, endpoint: Endpoint) -> None:
    made = endpoint.server.command("challenge", "token", "new", "--team", "Python", "--expires", "2d")
    token = next(word for word in made.split() if word.startswith("avln_"))
    code, output = program("doctor", "--phase", CHALLENGE, "--token", token)
    assert (code, "warning  token: of team 'Python'" in output) == (0, True), output
    assert "hours; ask the organiser" in output


def test_doctor_fails_without_server(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--server", "http://127.0.0.1:1", "--token", "x"]) == 6
    assert "failure  server: cannot reach" in capsys.readouterr().out


def test_quickstart_writes_agent_but_keeps_edited_file(program: Program, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr("avln.quickstart.AGENT", AGENT)
    file = tmp_path / "agent.py"
    code, output = program("quickstart", "--out", file, "--phase", PHASE)
    assert code == 0
    assert "complete" in output
    file.write_text("# changed")
    code, output = program("quickstart", "--out", file)
    assert (code, "the file exists already" in output) == (1, True)


def test_quickstart_agent_plays_run(program: Program, tmp_path: Path) -> None:
    code, output = program("quickstart", "--out", tmp_path / "written.py", "--phase", PHASE, "--size", 64)
    assert code == 0
    assert "3 of 3 episodes, complete" in output


def test_quickstart_reports_unwritable_path(program: Program, tmp_path: Path) -> None:
    for place in (tmp_path, tmp_path / "no" / "agent.py"):
        code, output = program("quickstart", "--out", place)
        assert (code, f"write an agent to {place}: " in output, "--out" in output) == (1, True, True)


def test_agent_imports_neighbours_without_shadowing_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "beside_the_agent.py").write_text(AGENT)
    (tmp_path / "random.py").write_text("from beside_the_agent import Agent")
    file = tmp_path / "random.py"
    assert load_agent(str(file)).__module__ == "beside_the_agent"
    assert sys.modules.get("random") is random
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "in_this_folder.py").write_text(AGENT)
    monkeypatch.chdir(elsewhere)
    assert load_agent("in_this_folder:Agent").__module__ == "in_this_folder"


def test_size_option_overrides_agent_sensors(program: Program, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(AGENT)
    code, output = program("run", file, "--phase", PHASE, "--size", 63)
    assert (code, "63 x 63" in output) == (1, True)


def test_runs_can_be_listed_and_cancelled(program: Program, endpoint: Endpoint) -> None:
    with endpoint.connect() as client:
        run = client.start_run(PHASE, "left alone").id
    assert f"{run}: {PHASE}, created, 0 of 3 episodes, left alone\n" in program("runs", "--phase", PHASE)[1]
    assert program("cancel", run) == (0, f"{run}: cancelled\n")
    assert f"{run}: {PHASE}, cancelled" in program("runs")[1]
    code, output = program("cancel", "run_of_nobody")
    assert (code, "RUN_UNKNOWN" in output) == (1, True)


def test_failed_run_prints_cancel_command(program: Program, tmp_path: Path) -> None:
    file = tmp_path / "breaks.py"
    file.write_text(AGENT.replace("return avln.Action.STOP", "raise avln.Error('no idea')"))
    code, output = program("run", file, "--phase", PHASE)
    assert (code, "no idea" in output) == (1, True)
    assert "avln-py cancel run_" in output


def test_quickstart_agent_avoids_walls(tmp_path: Path) -> None:
    import numpy as np  # noqa: PLC0415

    import avln  # noqa: PLC0415
    from avln import quickstart  # noqa: PLC0415

    file = tmp_path / "twenty_lines.py"
    quickstart.write(file)
    assert len(quickstart.AGENT.splitlines()) <= 24
    document = Path(__file__).parents[3] / "docs" / "QUICKSTART.md"
    assert quickstart.AGENT.split('"""\n\n', 1)[1] in document.read_text(encoding="utf-8")
    agent = load_agent(str(file))()
    agent.begin(avln.TaskSpec(), avln.Mission())
    free, wall = np.full((9, 9), 3.0, np.float32), np.full((9, 9), 0.5, np.float32)
    assert agent.act(avln.Observation(depth=free, remaining_steps=9)) is avln.Action.MOVE_FORWARD
    assert agent.act(avln.Observation(depth=wall, remaining_steps=9)) is avln.Action.TURN_LEFT
    assert agent.act(avln.Observation(depth=free, remaining_steps=1)) is avln.Action.STOP


def test_package_runs_as_module(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["avln", "--version"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("avln", run_name="__main__")
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("avln-py 0.")
