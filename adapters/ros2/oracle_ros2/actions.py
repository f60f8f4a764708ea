"""Actions: the proxy of one's five hidden interfaces, byte for byte and with the goals' own ids."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any, Callable, Mapping, Sequence

from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal

from oracle_ros2.circles import call_circle
from oracle_ros2.codec import load_type, write
from oracle_ros2.feedback import RelayedFeedback
from oracle_ros2.goals import Goals
from oracle_ros2.graph import hidden, past_proxy
from oracle_ros2.relay import MOST, UNDERWAY, Relay
from oracle_ros2.sides import Side, now
from oracle_ros2.stamps import ros_time, time_of
from oracle_ros2.standing import RelayedStatus
from oracle_ros2.statuses import ABORTED, UNKNOWN, word
from oracle_ros2.unserved import UnservedAction
from oracle_ros2.withdrawals import Withdrawals, cancel_request

if TYPE_CHECKING:
    from oracle_adapter.interfaces import Interface
    from oracle_adapter.passing import TakeBack

    from oracle_ros2.goals import Goal
    from oracle_ros2.relay import Call
    from oracle_ros2.shared import Shared
    from oracle_ros2.sides import When
    from oracle_ros2.standing import StatusStream
    from oracle_ros2.topics import Observed

SERVICES = ("send_goal", "cancel_goal", "get_result")
RESULT_DISCOVERY = 10.0
"""Seconds for an action's server to be discovered before a result is told as ABORTED: the goal may be one that it has
accepted before this adapter began, and go on."""
RESULT_PAUSE = 0.1
"""Seconds after which the server gets more of many calls for results: it reads them at once, and answers in the end."""


class ProxiedAction:
    """Serves `proxy` as an action, and passes on to the action itself what may pass."""

    def __init__(self, shared: Shared, action: Interface) -> None:
        """Serve at once. Raises `CodecError`."""
        node, board = shared.node, shared.board
        self._node, self._link, self._board = node, shared.link, board
        self.name = action.name
        first, streams = action.first, action.streams
        self._type = load_type(first["type"])
        self._impl = impl = self._type.Impl
        self._denied: Mapping[str, Any] = first.get("denied_result") or {}
        write(self._type.Result(), self._denied)
        served, proxy = shared.names[self.name], shared.names[first["proxy"]]
        self._proxied = [(hidden(served, service), hidden(proxy, service)) for service in SERVICES]
        self._circle = call_circle(node, *self._proxied[0])
        self._goals, self._now = Goals(), time_of(node)

        contents = {"goal": self._type.Goal, "reply": impl.SendGoalService.Response, "cancel": GoalInfo,
                    "result": self._type.Result}  # fmt: skip
        self._sides = {kind: Side(shared, s, contents[kind]) for kind, s in streams.items() if kind in contents}

        self._asks_results = "result" in self._sides and self._sides["result"].asks

        def topics(topic: str) -> tuple[str, str]:
            return hidden(served, topic), hidden(proxy, topic)

        def relay(
            kind: Any, service: str, ask: Callable[[Call], None], answer: Callable[[Call, Any], None],
            *patience: float,
        ) -> Relay:  # fmt: skip
            return Relay(node, kind, *topics(service), ask, answer, *patience)

        self._feedback = RelayedFeedback(
            shared, self.name, streams.get("feedback"), impl.FeedbackMessage, topics("feedback"), self._goals
        )
        self._status = RelayedStatus(shared, self.name, streams.get("status"), topics("status"), self._goals)
        self._sending = relay(impl.SendGoalService, "send_goal", self._ask_goal, self._answer_goal)
        self._cancelling = relay(CancelGoal, "cancel_goal", self._ask_cancel, self._answer_cancel)
        self._results = relay(
            impl.GetResultService, "get_result", self._ask_result, self._answer_result, RESULT_DISCOVERY, RESULT_PAUSE
        )
        self._withdrawals = Withdrawals(self._cancelling)
        observed = {**self._sides, "feedback": self._feedback.observed, "status": self._status.observed}
        self.streams: list[Side | Observed | StatusStream] = [
            found for kind in streams if (found := observed[kind]) is not None
        ]
        self._unserved = UnservedAction(node, served, proxy)
        self.doubt = ""
        """That nobody serves it, or hears what passes of its feedback, as of the last look."""
        self.bypass = ""
        """What lets goals and news of them past the monitor, as of the last look."""
        self._trouble = ""
        self._servers: dict[int, set[str]] = {}  # the servers that were there when a result was asked for, by call

    @property
    def received(self) -> int:
        """How many messages have come."""
        return self._feedback.count + self._status.count

    def catch_up(self) -> None:
        """Take what has come by now, and go on with what waits; to be called often, where callbacks run."""
        self._status.subscription.take_all()
        self._feedback.subscription.take_all()
        self._feedback.behind.catch_up()
        self._status.flush()
        if self._goals.tell_unasked(self._status.statuses, time.monotonic()):
            self._status.withheld()
        for call in self._sending.catch_up():
            self._give_up(call, f"{self.name} is not there: goal {_goal_of(call).hex()} is rejected")
        for call in self._sending.give_up():
            goal = f"goal {_goal_of(call).hex()}"
            self._give_up(call, f"{self.name} has not answered {goal}, nor {MOST} that came later: it is rejected")
        for call in (*self._cancelling.catch_up(), *self._cancelling.give_up()):
            call.given_up()
            self._keep(call)
        self._abort(self._results.catch_up())
        self._leave_unknown(self._results.give_up())
        self._withdrawals.catch_up(self._status.statuses)

    def look(self) -> str:
        """Look at the other nodes again, and return what is wrong."""
        self.doubt = "; ".join(filter(None, (self._unserved.look(), self._feedback.doubt)))
        relays = self._sending, self._cancelling, self._results
        kinds = (self._sending, "goal", "reply"), (self._cancelling, "cancel", ""), (self._results, "", "result")
        there = self._sides
        overdue = [relay.overdue(requests=ask in there, responses=answer in there) for relay, ask, answer in kinds]
        self._link.lost(sum(overdue))
        found = [*self._feedback.look(), *self._status.look(), *(text for relay in relays for text in relay.look())]
        self._abort(self._orphaned())
        self._circle.look()
        past = past_proxy(self._node, *self._proxied), self._circle.text, self._feedback.bypass, self._status.bypass
        self.bypass = "; ".join(text for text in past if text)
        if self._results.is_there:
            self._trouble = ""
        sides = [side.trouble for side in self._sides.values()]
        troubles = (*past[:2], *found, *sides, *self._withdrawals.troubles(), self._trouble)
        return "; ".join(trouble for trouble in troubles if trouble)

    def stop(self) -> None:
        """Serve no more. Goals under way go on, and whoever waits for a result is told that it is unknown here."""
        self._feedback.behind.release()
        goals, cancels, results = self._sending.end(), self._cancelling.end(), self._results.end()
        under_way = self._status.under_way if self._sending.is_there else 0
        for call in goals:
            if call.forwarded and self._cancelling.is_there:  # its client will believe it rejected
                self._cancelling.send(cancel_request(_goal_of(call)), lambda _: None)
            call.given_up()
            self._reject(call)
        for call in results:
            self._results.reply(call, self._impl.GetResultService.Response(status=UNKNOWN))
        for call in cancels:
            call.given_up()
            self._keep(call)
        if under_way or results:
            self._board.error(
                f"the monitor of {self.name} ends: {under_way} goals go on at the server, "
                f"and {len(results)} calls that wait for results are told that these are unknown"
            )
        if goals or cancels or results:
            time.sleep(UNDERWAY)  # answers that have not arrived yet go with the service
        for relay in (self._sending, self._cancelling, self._results):
            relay.destroy()
        self._feedback.stop()
        self._status.stop()

    # A goal, and its reply

    def _ask_goal(self, call: Call) -> None:
        goal = _goal_of(call)
        self._goals.begin(goal, self._now())

        def give() -> bool:
            if self._circle.text:
                self._reject(call)
                return False
            return self._sending.forward(call)

        refuse = partial(self._reject, call)
        before = call.may_be_taken_back
        self._judge("goal", call.request.goal, give, refuse, goal, call.number, lost=call.lost, before=before)

    def _answer_goal(self, call: Call, response: Any) -> None:
        goal = _goal_of(call)

        def refuse() -> None:
            if response.accepted:
                self._goals.refuse(goal)
                self._withdrawals.add(goal)
            self._reject(call)

        def give() -> bool:
            if response.accepted:
                self._goals.renew(goal, decides_result=self._asks_results)
            told = self._sending.reply(call, response)
            if told:
                self._settle(goal)
            else:
                refuse()
            return told

        status = "accepted" if response.accepted else "rejected"
        self._judge("reply", response, give, refuse, goal, call.number, status, lost=call.lost)

    def _reject(self, call: Call) -> bool:
        told = self._sending.reply(call, self._impl.SendGoalService.Response(accepted=False))
        self._settle(_goal_of(call))
        return told

    def _give_up(self, call: Call, why: str) -> None:
        """Wait for a goal's reply no more."""
        if call.forwarded:  # the server may have accepted it all the same
            self._goals.refuse(_goal_of(call))
            self._withdrawals.add(_goal_of(call))
        if self._reject(call):
            call.given_up()
            self._board.error(why)

    def _settle(self, goal: Goal) -> None:
        """The client has its reply: what comes after that may come.

        Statuses come with the next `catch_up`, as rclpy's clients would read an array of 200 before the reply, for
        5 ms.
        """
        waiting = self._goals.settle(goal)
        self._feedback.reply_settled(goal)
        self._status.report()
        for call in waiting:
            call()

    # Cancelling

    def _ask_cancel(self, call: Call) -> None:
        if self._circle.text:
            self._keep(call)
            return
        info = call.request.goal_info
        goal = bytes(info.goal_id.uuid)
        give, refuse = lambda: self._cancel(call, goal), lambda: self._keep(call)
        before = call.may_be_taken_back
        self._judge("cancel", info, give, refuse, goal, call.number, lost=call.lost, before=before)

    def _cancel(self, call: Call, goal: Goal) -> bool:
        """Pass a cancel on, not before its goal: what is on its way would go on else."""
        stamp = ros_time(call.request.goal_info.stamp)
        if stamp or not any(goal):  # it is about all goals that came by then, too
            for other in self._goals.unsettled_by(stamp):
                if other != goal:
                    self._goals.after_reply(other, lambda other=other: self._cancel_late(other))
        if any(goal) and self._goals.after_reply(goal, lambda: self._cancelling.forward(call)):
            return True
        return self._cancelling.forward(call)

    def _cancel_late(self, goal: Goal) -> None:
        """Cancel a goal that a cancel is about, and that was accepted after it."""
        if self._cancelling.is_there:
            self._cancelling.send(cancel_request(goal), lambda _: None)

    def _answer_cancel(self, call: Call, response: Any) -> None:
        self._cancelling.reply(call, response)

    def _keep(self, call: Call) -> bool:
        rejected = CancelGoal.Response(return_code=CancelGoal.Response.ERROR_REJECTED)
        return self._cancelling.reply(call, rejected)

    # A result

    def _ask_result(self, call: Call) -> None:
        goal = _goal_of(call)
        if self._circle.text or self._goals.is_withheld(goal):
            self._withhold(call)
            return
        if self._asks_results:
            self._goals.await_result(goal)
        self._servers[call.number] = set(self._status.subscription.sources)
        self._results.forward(call)

    def _answer_result(self, call: Call, response: Any) -> None:
        goal = _goal_of(call)
        self._feedback.subscription.take_all()  # the server has published it before
        self._status.flush()

        def refuse() -> None:
            self._goals.withhold(goal)
            self._withhold(call)
            self._decide(call)

        def give() -> bool:
            told = self._results.reply(call, response)
            if told and self._asks_results:
                self._goals.tell(goal)
            self._decide(call)
            return told

        if self._goals.is_withheld(goal):
            refuse()
            return
        if self._asks_results:
            self._goals.decide(goal)
        status, when = word(response.status), partial(self._feedback.behind.after, goal)
        self._judge("result", response.result, give, refuse, goal, status=status, when=when, lost=call.lost)

    def _withhold(self, call: Call) -> bool:
        response = self._impl.GetResultService.Response(status=ABORTED)
        write(response.result, self._denied)
        return self._results.reply(call, response)

    def _leave_unknown(self, calls: Sequence[Call]) -> None:
        """Wait for some results no more, as too many are asked for: their goals may go on."""
        for call in calls:
            if self._results.reply(call, self._impl.GetResultService.Response(status=UNKNOWN)):
                self._board.error(
                    f"{self.name} has not told the result of goal {_goal_of(call).hex()}, nor {MOST} that were asked "
                    "for later: who waits for it is told that it is unknown"
                )
            self._decide(call)

    def _decide(self, call: Call) -> None:
        """A result is decided on, or none will come: how its goal stands may be told."""
        if self._servers.pop(call.number, None) is not None:
            self._goals.decided(_goal_of(call))
            self._status.flush()
            self._status.withheld()

    def _orphaned(self) -> list[Call]:
        """The calls for results of a server that has ended, though there is another one by now."""
        there = set(self._status.subscription.sources)
        found = []
        for call in self._results.unanswered:
            servers = self._servers.get(call.number)
            if servers is None or not there:
                continue
            if not servers:
                self._servers[call.number] = there
            elif not servers & there:
                found.append(call)
        return found

    def _abort(self, calls: Sequence[Call]) -> None:
        """Answer for a server that has ended."""
        goals = {_goal_of(call) for call in calls if self._withhold(call)}
        for call in calls:
            self._decide(call)
        if goals:
            self._trouble = f"its server has ended with {len(goals)} goals under way: their results are ABORTED"
            self._board.trouble(self.name, self._trouble)

    def _judge(
        self, kind: str, message: Any, give: Callable[[], bool], refuse: Callable[[], object], goal: Goal,
        call: int | None = None, status: str | None = None, when: When = now, lost: int = 0,
        before: Callable[[TakeBack], object] = lambda _: None,
    ) -> None:  # fmt: skip
        side = self._sides.get(kind)
        if side is None:
            when(give)
        else:
            side.judge(message, give, refuse, call, goal.hex() if any(goal) else "", status, when, lost, before)


def _goal_of(call: Call) -> Goal:
    return bytes(call.request.goal_id.uuid)
