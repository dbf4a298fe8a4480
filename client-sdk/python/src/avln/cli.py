"""Command line of `avln-py` and `python -m avln`."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable

from avln import doctor, quickstart
from avln.agent import evaluate_slots
from avln.client import connect
from avln.errors import Error
from avln.options import PRACTICE, add_camera, add_connection, add_run, begin_from, connect_options, parser, sensors
from avln.player import UnknownAgentError, load_agent
from avln.progress import Bar

if TYPE_CHECKING:
    import argparse

    from avln.service import Quota
    from avln.task import Sensors

WOULD_FAIL = 6
"""`doctor`'s exit code if a run would fail."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the program and returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except (Error, UnknownAgentError) as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130


def bridge() -> int:
    """Runs `avln-bridge`, which has extra dependencies, and returns the exit code."""
    try:
        from avln.bridge import main as program  # noqa: PLC0415
    except ModuleNotFoundError as error:
        print(error, file=sys.stderr)
        return 1
    return program()


def _parser() -> argparse.ArgumentParser:
    program = parser("avln-py", "Play runs on LH-AVLN Arena servers")
    commands = program.add_subparsers(dest="name", required=True, metavar="COMMAND")

    def add(name: str, about: str, command: Callable[[argparse.Namespace], int]) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=about, description=about[0].upper() + about[1:])
        added.set_defaults(command=command)
        return added

    add_connection(add("whoami", "print the token's team, name, scope and expiry", _whoami))
    add_connection(add("phases", "list phases", _phases), needs_token=False)
    quota = add("quota", "print the team's remaining runs", _quota)
    add_connection(quota)
    quota.add_argument("--phase", default="", help="phase to print [all]")
    runs = add("runs", "list the team's runs, newest first", _runs)
    add_connection(runs)
    runs.add_argument("--phase", default="", help="phase to list [all]")
    cancel = add("cancel", "cancel a run of the team", _cancel)
    add_connection(cancel)
    cancel.add_argument("run", help="run id, as printed by the command runs")
    _add_run(add("run", "play a run with your agent", _run))
    about = "check before a run that it will succeed: token, clock, versions, quota, speed, and practice episodes"
    _add_doctor(add("doctor", about, _doctor))
    _add_quickstart(add("quickstart", "write an agent of 20 lines and play a run with it", _quickstart))
    _add_bench(add("bench", "measure the speed of training environments in this process", _bench))
    return program


def _add_run(to: argparse.ArgumentParser) -> None:
    to.add_argument("agent", help="FILE.py, FILE.py:CLASS or MODULE:CLASS; the default class is Agent")
    add_connection(to)
    add_run(to, method="python-agent")
    add_camera(to, size=256)
    to.add_argument("--slots", type=int, default=1, help="episodes to play in parallel, each with a separate agent [1]")


def _add_doctor(to: argparse.ArgumentParser) -> None:
    add_connection(to)
    to.add_argument("--phase", default="", help=f"phase of the planned run {PRACTICE}")
    practice = "phase for the practice episodes; phases that count runs are not played [--phase]"
    to.add_argument("--practice", help=practice)
    to.add_argument("--episodes", type=int, default=5, help="practice episodes [5]")
    to.add_argument("--steps", type=int, default=100, help="action limit per practice episode [100]")
    add_camera(to, size=256)
    to.add_argument("--json", action="store_true", help="print JSON")


def _add_quickstart(to: argparse.ArgumentParser) -> None:
    add_connection(to)
    add_run(to, method="quickstart")
    add_camera(to, size=128)
    to.add_argument("--out", type=Path, default=Path("agent.py"), help="file for the agent [agent.py]")


def _add_bench(to: argparse.ArgumentParser) -> None:
    to.add_argument("--num-envs", type=int, default=8, help="environments [8]")
    to.add_argument("--threads", type=int, help="worker threads [one per processor]")
    to.add_argument("--batch-size", type=int, help="environments per recv, with send and recv instead of step [all]")
    to.add_argument("--size", type=int, default=128, help="image side, pixels [128]")
    to.add_argument(
        "--senses", default="rgbd,audio", help="any of rgb, depth, rgbd, audio, lidar, ears, map [rgbd,audio]"
    )
    to.add_argument("--seconds", type=float, default=20.0, help="time without preparation [20]")
    to.add_argument("--json", action="store_true", help="print JSON")


def _bench(options: argparse.Namespace) -> int:
    try:
        from avln.sim.bench import measure  # noqa: PLC0415

        senses = options.senses.replace("rgbd", "rgb,depth").split(",")
        envs = (options.num_envs, options.threads, options.size, senses)
        speed = measure(*envs, options.seconds, options.batch_size)
    except (ModuleNotFoundError, RuntimeError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    if options.json:
        print(json.dumps(speed))
    else:
        print(f"{speed['steps_per_s']:.0f} steps/s, {1e3 * speed['cpu_s_per_step']:.3f} ms of processor time per step")
        print(f"{speed['rss_mib']:.0f} MiB resident")
    return 0


def _whoami(options: argparse.Namespace) -> int:
    with connect(options.server, options.token, connect_options(options)) as client:
        account = client.whoami()
        expiry = "no expiry" if account.expires_unix_s == 0 else f"expires {_date(account.expires_unix_s)}"
        print(f"team {account.team}, token {account.token_name or 'without a name'} ({account.scope}), {expiry}")
    return 0


def _phases(options: argparse.Namespace) -> int:
    with connect(options.server, options.token, connect_options(options)) as client:
        for phase in client.phases():
            orders = ", ".join(order.value for order in phase.orders)
            print(f"{phase.id}: {phase.state}, {phase.episodes} episodes, {orders}, {phase.rules}, {phase.title}")
    return 0


def _quota(options: argparse.Namespace) -> int:
    with connect(options.server, options.token, connect_options(options)) as client:
        for quota in client.quota(options.phase):
            print(f"{quota.phase}, {quota.window}: {_left(quota)}")
    return 0


def _left(quota: Quota) -> str:
    if quota.remaining is None:
        return f"unlimited runs, {quota.used} counted"
    again = f", more from {_date(quota.next_increase_unix_s)}" if quota.next_increase_unix_s else ""
    return f"{quota.remaining} of {quota.limit} runs remain{again}"


def _date(unix_s: int) -> str:
    return datetime.fromtimestamp(unix_s, timezone.utc).strftime("%Y-%m-%d %H:%M UTC")


def _run(options: argparse.Namespace) -> int:
    make = load_agent(options.agent)
    agents = [make() for _ in range(max(options.slots, 1))]
    wanted = _sensors(agents[0], options)
    client, run = begin_from(options, wanted)
    try:
        with client, Bar(run.episodes) as bar:
            summary = evaluate_slots(client, run, agents, wanted, bar.tell)
    except BaseException:
        print(f"run {run.id} may still be open; to cancel it: avln-py cancel {run.id}", file=sys.stderr)
        raise
    print(summary)
    return 0


def _sensors(agent: Any, options: argparse.Namespace) -> Sensors:
    """Returns the agent's sensors, if any; `--size` overrides their image size."""
    wanted: Sensors | None = getattr(agent, "sensors", None)
    if wanted is None:
        return sensors(options)
    return wanted if options.size is None else replace(wanted, width=options.size, height=options.size)


def _runs(options: argparse.Namespace) -> int:
    with connect(options.server, options.token, connect_options(options)) as client:
        for run in client.runs(options.phase):
            progress = f"{run.progress.done} of {run.progress.total} episodes"
            print(f"{run.id}: {run.phase}, {run.state}, {progress}, {run.method}")
    return 0


def _cancel(options: argparse.Namespace) -> int:
    with connect(options.server, options.token, connect_options(options)) as client:
        run = client.cancel_run(options.run)
        print(f"{run.id}: {run.state}")
    return 0


def _doctor(options: argparse.Namespace) -> int:
    checks = doctor.examine(
        options.server,
        options.token,
        options.phase,
        connect_options=connect_options(options),
        practice=options.practice,
        episodes=options.episodes,
        steps=options.steps,
        sensors=sensors(options),
    )
    found: list[Any] = []
    for check in checks:
        found.append(check.as_dict())
        if not options.json:
            print(check)
    if options.json:
        print(json.dumps({"checks": found}, indent=2))
    return WOULD_FAIL if any(check["verdict"] == doctor.FAILS for check in found) else 0


def _quickstart(options: argparse.Namespace) -> int:
    quickstart.write(options.out)
    print(f"wrote {options.out}; edit the method act and play again:")
    named = f" --phase {options.phase}" if options.phase else ""
    print(f"  avln-py run {options.out}{named}")
    options.agent, options.slots = str(options.out), 1
    return _run(options)
