"""Replies to the authors' requests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable

from avln.action import Action, Order
from avln.errors import Error
from avln.habitat import Senses, goal_input, to_action
from avln.observation import Feedback, Pose

if TYPE_CHECKING:
    from avln.mission import Goal
    from avln.observation import Observation
    from avln.play import Episode, Play

KEYS = ("rgb", "depth", "audiogoal", "spectrogram", "full_pose_sensor")
"""Observation entries sent to the agent: no instance ids, no path to the goal."""
_HIDDEN = "hidden"
_METRICS = {"sr": "success", "spl": "spl", "soft_spl": "softspl", "sna": "na"}


class RequestHandler:
    """A handler for the authors' requests; it plays a run.

    | request | answer |
    | --- | --- |
    | `reset` or `start` | `episode_start`, or `run_end` if no episode remains |
    | `action` with `action` 0 to 4 | `step` |
    | `ping` | `pong` |
    | `close` | `closed`: the run ends |

    Invalid requests are answered with `error` and a `message`; the run continues. Scene and
    episode names are opaque, metrics are sent if the phase shows them, and verdicts if the rules
    allow them.
    """

    def __init__(self, run: Play) -> None:
        self._run = run
        self._senses = Senses(run.task, KEYS, max_depth_m=run.task.depth_max_m)
        self._episode: Episode | None = None
        self._start = Pose()
        self._submits = 0
        self.is_closed = False
        """True after the client has closed the session."""

    def answer(self, request: Any) -> dict[str, Any]:
        """Returns the reply to a request."""
        try:
            return self._answerer(request)()
        except (Error, ValueError) as error:
            return {"op": "error", "message": str(error)}

    def _answerer(self, request: Any) -> Callable[[], dict[str, Any]]:
        op = str(request.get("op", "")).strip().lower() if isinstance(request, dict) else ""
        answerers: dict[str, Callable[[], dict[str, Any]]] = {
            "reset": self._reset,
            "start": self._reset,
            "action": lambda: self._act(request.get("action")),
            "ping": lambda: {"op": "pong", "episodes_total": self._run.progress.total},
            "close": self._close,
        }
        if op not in answerers:
            raise ValueError(f"read a request: unknown op {op!r}; use {', '.join(sorted(answerers))}")
        return answerers[op]

    def _reset(self) -> dict[str, Any]:
        episode = self._run.next_episode()
        if episode is None:
            return {"op": "run_end", "episodes_total": self._run.progress.total, "summary": self._summary()}
        self._episode, self._submits = episode, 0
        self._start = episode.observation.pose
        return {
            "op": "episode_start",
            "episode_index": episode.ordinal - 1,
            "episode": self._episode_fields(episode),
            "observations": self._observations(episode),
            "scene": _HIDDEN,
            "step_index": 0,
        }

    def _episode_fields(self, episode: Episode) -> dict[str, Any]:
        """Returns the episode fields in the authors' format; scene names are opaque."""
        pose = self._senses.observations(episode.observation, self._start, episode.mission)["full_pose_sensor"]
        return {
            "episode_id": episode.id,
            "scene_id": _HIDDEN,
            "scene_name": _HIDDEN,
            "goal_inputs": [_goal(goal) for goal in episode.mission.goals],
            "goal_count": len(episode.mission.goals),
            "goal_order_mode": "ordered" if episode.mission.order is Order.ORDERED else "unordered",
            "start_position": pose[:3].tolist(),
            "start_rotation": pose[3:].tolist(),
        }

    def _observations(self, episode: Episode) -> dict[str, Any]:
        return self._senses.observations(episode.observation, self._start, episode.mission)

    def _act(self, choice: Any) -> dict[str, Any]:
        episode = self._episode
        if episode is None or episode.is_over:
            raise ValueError("take a step: no episode is open; send reset first")
        if choice is None:
            raise ValueError("take a step: the field action is missing; send an integer from 0 to 4")
        action = to_action(choice)
        # In the authors' protocol the N-th Submit ends the episode. Here this is a Stop under every rule set.
        is_last = action is Action.SUBMIT and episode.observation.remaining_submits == 0
        seen = episode.act(Action.STOP if is_last else action)
        self._submits += action is Action.SUBMIT
        answer = {
            "op": "step",
            "episode_index": episode.ordinal - 1,
            "step_index": seen.step,
            "action": choice,
            "observations": self._observations(episode),
            "reward": None,
            "done": episode.is_over,
            "info": self._info(action, seen, episode),
            "metrics": {},
        }
        return {**answer, **self._ending(episode)} if episode.is_over else answer

    def _info(self, action: Action, seen: Observation, episode: Episode) -> dict[str, Any]:
        names = {Action.STOP: "STOP", Action.SUBMIT: "LIFELONG_SUBMIT"}
        feedback = {
            "action_name": names.get(action),
            "found_goal_this_step": _verdict(seen.feedback),
            "found_goal_index": -1,
            "remaining_submit_count": seen.remaining_submits,
            "submit_count": self._submits,
            "submit_limit": len(episode.mission.goals),
            "goal": {"goal_index": -1},
        }
        return {"feedback": feedback, "step_index": seen.step, "scene": _HIDDEN, "episode_id": episode.id}

    def _ending(self, episode: Episode) -> dict[str, Any]:
        return {
            "episode": self._episode_fields(episode),
            "episode_metrics": _metrics(episode),
            "summary": self._summary(),
        }

    def _summary(self) -> dict[str, Any]:
        return {"episodes_completed": self._run.progress.done, "task_type": "lh-avln"}

    def _close(self) -> dict[str, Any]:
        self.is_closed = True
        self._run.finish()
        return {"op": "closed", "summary": self._summary()}


def _goal(goal: Goal) -> dict[str, Any]:
    fields = goal_input(goal)
    return {**fields, "detected_objects": []} if "image" in fields else fields


def _verdict(feedback: Feedback) -> bool | None:
    """Returns True if a Submit completed a goal; None if the rules hide it."""
    return feedback is Feedback.CORRECT if feedback in (Feedback.CORRECT, Feedback.WRONG) else None


def _metrics(episode: Episode) -> dict[str, Any]:
    """Returns public metrics with the authors' names; empty if the phase hides them."""
    shown = (episode.end.metrics if episode.end else None) or []
    named = {_METRICS[metric.name]: metric.value for metric in shown if metric.name in _METRICS}
    found = next((metric.value for metric in shown if metric.name == "isr"), None)
    if found is not None:
        goals = len(episode.mission.goals)
        named |= {"found_goals": round(found * goals), "num_goals": goals}
    return named
