"""A proxied action on real ROS 2: what passes, what doesn't, and what its client and server are told."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from tests.adapters.standin import described
from tests.processes import Data
from tests.ros2.acting import (
    ABORTED,
    CANCELED,
    DENIED,
    KINDS,
    SUCCEEDED,
    UNKNOWN,
    Client,
    acting,
    action_msgs,
    action_srvs,
    hex_of,
    qos,
    streams,
    test_msgs,
)
from tests.ros2.harness import eventually

# rclpy imports an old lark with its first node, and warns by functions of its own that are deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)
LASTING = qos.qos_profile_action_status_default


def shown(client: Client) -> dict[str, list[int]]:
    """The statuses that a client is told of each goal, as they come."""
    found: dict[str, list[int]] = {}

    def take(array: object) -> None:
        for one in array.status_list:  # type: ignore[attr-defined]
            told = found.setdefault(bytes(one.goal_info.goal_id.uuid).hex(), [])
            if told[-1:] != [one.status]:
                told.append(one.status)

    client.peer.node.create_subscription(action_msgs.GoalStatusArray, f"{client.name}/_action/status", take, LASTING)
    return found


@pytest.mark.parametrize("asked", [(), ("goal", "reply", "feedback", "cancel", "result")])
def test_what_may_pass_is_as_it_is_without_a_proxy(asked: tuple[str, ...], tmp_path: Path) -> None:
    with acting(tmp_path, streams(*asked)) as scene:
        server, client = scene.server(), scene.client()
        told = shown(client)
        client.meet()
        before = server.log.count("goal ")
        goal = client.goal(5)
        assert goal.accepted
        assert client.result(goal) == (SUCCEEDED, [0, 1, 2, 3, 4])
        client.peer.until(lambda: len(client.heard.get(hex_of(goal), [])) == 5)
        client.peer.until(lambda: told[hex_of(goal)][-1] == SUCCEEDED)
        assert client.heard[hex_of(goal)] == [0, 1, 2, 3, 4]
        rejected, aborted = client.goal(1000), client.goal(13)
        assert not rejected.accepted
        assert client.result(aborted) == (ABORTED, list(range(13)))
        mine = [hex_of(one) for one in (goal, rejected, aborted)]

        def told_of(kind: str) -> list[Data]:
            return [event for event in scene.judge.of(kind) if event["goal_id"] in mine]

        eventually(lambda: told_of("result"), lambda found: len(found) == 2)
        events = [e for e in scene.judge.seen if e.get("goal_id") == hex_of(goal)]
        assert {event["kind"] for event in events} == {*KINDS} - {"cancel"}
        [asking] = [e for e in events if e["kind"] == "goal"]
        [reply] = [e for e in events if e["kind"] == "reply"]
        assert (asking["data"], reply["data"], reply["status"]) == ({"order": 5}, {"accepted": True}, "accepted")
        assert asking["call"] == reply["call"]
        assert [e["status"] for e in events if e["kind"] == "status"] == ["accepted", "executing", "succeeded"]
        assert [e["data"] for e in events if e["kind"] == "feedback"] == [{"sequence": [n]} for n in range(5)]
        assert [e["status"] for e in told_of("reply")] == ["accepted", "rejected", "accepted"]
        assert [(e["status"], "call" in e) for e in told_of("result")] == [("succeeded", False), ("aborted", False)]
        assert {e["kind"] for e in scene.judge.seen if e["ask"]} == {*asked} - {"cancel"}
        assert server.log.count("goal ") - before == 3
        scene.adapter.ends_well()


def test_a_denied_goal_is_rejected_and_its_server_never_hears_of_it(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal")) as scene:
        server, client = scene.server(), scene.client()
        scene.judge.denies = lambda event: bool(event["data"]["order"] == 7)
        assert not client.goal(7).accepted
        assert client.goal(1).accepted
        server.said("goal 1")
        assert "goal 7" not in server.log
        scene.adapter.said("denied a goal of /fib, goal [0-9a-f]{32}: rule")
        scene.adapter.ends_well()


def test_a_denied_reply_is_a_rejection_and_its_goal_is_cancelled(tmp_path: Path) -> None:
    with acting(tmp_path, streams("reply")) as scene:
        server, client = scene.server(), scene.client()
        told = shown(client)
        scene.judge.denies = lambda event: event["status"] == "accepted"
        assert not client.goal(400).accepted
        server.said("cancelled 400")
        [reply] = scene.judge.of("reply")
        eventually(lambda: [e["status"] for e in scene.judge.of("status")], lambda told: told[-1:] == ["canceled"])
        scene.judge.denies = lambda _: False
        after = client.goal(1)
        assert client.result(after) == (SUCCEEDED, [0])
        assert [e["goal_id"] for e in scene.judge.of("status")].count(reply["goal_id"]) >= 3
        assert reply["goal_id"] not in client.heard
        client.peer.until(lambda: told.get(hex_of(after), [])[-1:] == [SUCCEEDED])
        assert reply["goal_id"] not in told
        scene.adapter.ends_well()


def test_a_goal_that_goes_on_after_a_denied_reply_is_told_and_cancelled_again(tmp_path: Path) -> None:
    with acting(tmp_path, streams("reply")) as scene:
        server, client = scene.server(), scene.client()
        scene.judge.denies = lambda _: True
        assert not client.goal(600).accepted
        eventually(lambda: server.log.count("asked to cancel 600"), lambda count: count >= 2)
        eventually(lambda: scene.judge.reports.get("/fib goal", ""), lambda text: "is cancelled until it ends" in text)
        server.said("ended 600")
        eventually(lambda: scene.judge.reports["/fib goal"], lambda text: not text)
        scene.adapter.ends_well()


def test_denied_feedback_does_not_come(tmp_path: Path) -> None:
    with acting(tmp_path, streams("feedback")) as scene:
        scene.server()
        client = scene.client()
        client.meet()
        scene.judge.denies = lambda event: bool(event["data"]["sequence"][0] % 2)
        goal = client.goal(20)
        assert client.result(goal) == (SUCCEEDED, list(range(20)))
        client.peer.until(lambda: client.heard[hex_of(goal)][-1:] == [18])
        assert client.heard[hex_of(goal)] == list(range(0, 20, 2))
        scene.adapter.ends_well()


def test_a_denied_cancel_is_rejected_and_the_goal_goes_on(tmp_path: Path) -> None:
    with acting(tmp_path, streams("cancel")) as scene:
        server, client = scene.server(), scene.client()
        scene.judge.denies = lambda event: event["kind"] == "cancel"
        goal = client.goal(100)
        answer = client.cancel(bytes(goal.goal_id.uuid))
        assert (answer.return_code, list(answer.goals_canceling)) == (answer.ERROR_REJECTED, [])
        assert client.result(goal)[0] == SUCCEEDED
        assert "asked to cancel" not in server.log
        scene.adapter.ends_well()


def test_a_denied_result_is_an_abort_with_what_the_spec_says(tmp_path: Path) -> None:
    with acting(tmp_path, streams("result")) as scene:
        scene.server()
        client = scene.client()
        told = shown(client)
        scene.judge.denies = lambda event: event["status"] == "succeeded"
        goal = client.goal(10)
        assert client.result(goal) == (ABORTED, DENIED["sequence"])
        client.peer.until(lambda: told[hex_of(goal)][-1] == ABORTED)
        assert SUCCEEDED not in told[hex_of(goal)]
        assert client.result(goal) == (ABORTED, DENIED["sequence"]), "asked again"
        assert len(scene.judge.of("result")) == 1
        late = shown(scene.client())
        client.peer.until(lambda: not late)
        assert [e["status"] for e in scene.judge.of("status")][-1] == "succeeded", "as it was"
        scene.adapter.ends_well()


def test_a_late_joiner_is_told_how_goals_stand(tmp_path: Path) -> None:
    with acting(tmp_path, streams(kinds=("goal",))) as scene:
        scene.server()
        client = scene.client()
        goal = client.goal(3)
        assert client.result(goal)[0] == SUCCEEDED
        late = scene.client()
        told = shown(late)
        late.peer.until(lambda: told.get(hex_of(goal)) == [SUCCEEDED])
        scene.adapter.ends_well()


def test_goals_of_three_clients_at_once_keep_what_is_theirs(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal", "reply", "feedback", "result")) as scene:
        scene.server(0.05)
        peer = scene.scene.peer()
        clients = [Client(peer, "/fib_mon", 1000) for _ in range(3)]
        for client in clients:
            client.meet()
        scene.judge.denies = lambda event: event["kind"] == "goal" and event["data"]["order"] == 25
        sent = [(clients[order % 3], order, clients[order % 3].send(order)) for order in range(20, 40)]
        goals = [(client, order, client.done(future)) for client, order, future in sent]
        assert [order for _, order, goal in goals if not goal.accepted] == [25]
        ended = [(client, order, goal, goal.get_result_async()) for client, order, goal in goals if goal.accepted]
        for client, order, goal, future in ended:
            result = client.done(future)
            assert (result.status, list(result.result.sequence)) == (SUCCEEDED, list(range(order)))
            client.peer.until(lambda c=client, g=goal, n=order: len(c.heard[hex_of(g)]) == n)
            assert client.heard[hex_of(goal)] == list(range(order))
        scene.adapter.ends_well()


@pytest.mark.parametrize("asked", [(), ("goal", "cancel")])
def test_cancels_at_and_after_acceptance_and_of_all(asked: tuple[str, ...], tmp_path: Path) -> None:
    with acting(tmp_path, streams(*asked)) as scene:
        server, client = scene.server(), scene.client()
        goals = [client.goal(order) for order in (400, 401, 402)]
        answer = client.done(goals[0].cancel_goal_async())
        assert [bytes(one.goal_id.uuid) for one in answer.goals_canceling] == [bytes(goals[0].goal_id.uuid)]
        assert client.result(goals[0])[0] == CANCELED
        assert client.cancel().return_code == 0
        client.cancel()  # rclpy's server leaves out some of those that it is to cancel at once
        assert [client.result(goal)[0] for goal in goals[1:]] == [CANCELED, CANCELED]
        assert client.cancel(bytes(goals[0].goal_id.uuid)).return_code == 3, "it has ended"
        unknown = client.cancel(bytes(range(16)))
        assert unknown.return_code == 2
        eventually(lambda: scene.judge.of("cancel"), lambda found: len(found) == 5)
        assert [e["goal_id"] for e in scene.judge.of("cancel")] == [
            hex_of(goals[0]), "", "", hex_of(goals[0]), bytes(range(16)).hex()
        ]  # fmt: skip
        assert server.log.count("cancelled") == 3
        scene.adapter.ends_well()


@pytest.mark.parametrize("everything", [True, False])
def test_a_cancel_that_comes_before_the_decision_on_its_goal_ends_it(everything: bool, tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal", decide_within=3 * 10**9, on_unavailable="pass")) as scene:
        server, client = scene.server(), scene.client()
        scene.judge.answers = False
        sent = client.send(400)
        [goal] = eventually(lambda: scene.judge.of("goal"), bool)
        answer = client.cancel(bytes(16) if everything else bytes.fromhex(goal["goal_id"]))
        assert answer.return_code == 0 or everything
        assert client.result(client.done(sent))[0] == CANCELED
        server.said("cancelled 400")
        scene.adapter.ends_well()


def test_a_cancel_by_time_spares_a_goal_that_came_later_and_is_not_decided_on(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal", decide_within=3 * 10**9, on_unavailable="pass")) as scene:
        server, client = scene.server(), scene.client()
        scene.judge.answers = False
        older = client.send(400)
        eventually(lambda: scene.judge.of("goal"), lambda found: len(found) == 1)
        between = time.time_ns()
        newer = client.send(30)
        eventually(lambda: scene.judge.of("goal"), lambda found: len(found) == 2)
        client.cancel(stamp=between)
        assert client.result(client.done(older))[0] == CANCELED
        assert client.result(client.done(newer))[0] == SUCCEEDED
        server.said("cancelled 400")
        scene.adapter.ends_well()


def test_a_cancel_passes_while_the_oracle_is_away(tmp_path: Path) -> None:
    with acting(tmp_path, streams("cancel", "result", decide_within=400_000_000)) as scene:
        server, client = scene.server(), scene.client()
        goal = client.goal(400)
        scene.judge.answers = False
        assert client.done(goal.cancel_goal_async()).return_code == 0
        server.said("cancelled 400")
        assert client.result(goal) == (ABORTED, DENIED["sequence"]), "it is withheld, as the spec says"
        scene.adapter.ends_well()


@pytest.mark.parametrize("policy", ["deny", "pass"])
def test_without_an_oracle_a_goal_is_treated_as_the_spec_says(policy: str, tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal", decide_within=400_000_000, on_unavailable=policy)) as scene:
        scene.server()
        client = scene.client()
        scene.judge.answers = False
        assert client.goal(1).accepted == (policy == "pass")
        scene.adapter.ends_well()


def test_without_a_server_a_goal_is_rejected_and_with_one_that_comes_it_is_not(tmp_path: Path) -> None:
    with acting(tmp_path, streams()) as scene:
        client = scene.client()
        assert not client.goal(1).accepted
        scene.adapter.said("/fib is not there: goal [0-9a-f]{32} is rejected")
        assert client.cancel().return_code == 1
        scene.server()
        client.peer.until(lambda: client.goal(1).accepted)
        scene.adapter.ends_well()


def test_goals_of_a_server_that_ends_are_aborted_and_a_new_one_takes_others(tmp_path: Path) -> None:
    with acting(tmp_path, streams()) as scene:
        server, client = scene.server(), scene.client()
        goals = [client.goal(400), client.goal(401)]
        results = [goal.get_result_async() for goal in goals]
        eventually(lambda: scene.judge.of("feedback"), lambda found: len(found) > 10)
        server.end(signal.SIGTERM)
        assert [client.done(result).status for result in results] == [ABORTED, ABORTED]
        eventually(lambda: scene.judge.reports.get("/fib goal", ""), lambda text: "its server has ended with" in text)
        scene.server()
        client.peer.until(lambda: client.goal(1).accepted)
        eventually(lambda: scene.judge.reports["/fib goal"], lambda text: not text)
        scene.adapter.ends_well()


def test_when_the_monitor_ends_goals_go_on_and_results_are_unknown(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal")) as scene:
        server, client = scene.server(), scene.client()
        goal = client.goal(200)
        result = goal.get_result_async()
        eventually(lambda: scene.judge.of("feedback"), lambda found: len(found) > 10)
        scene.adapter.ends_well()
        assert client.done(result).status == UNKNOWN
        assert "the monitor of /fib ends: 1 goals go on at the server, and 1 calls" in scene.adapter.log
        adapter = scene.monitor()
        client.peer.until(client.client.server_is_ready)
        assert client.result(goal) == (SUCCEEDED, list(range(200)))
        server.said("ended 200")
        adapter.ends_well()


def test_results_expire_as_they_do_without_a_proxy(tmp_path: Path) -> None:
    with acting(tmp_path, streams("result")) as scene:
        scene.server(0.01, 1)
        client = scene.client()
        goal = client.goal(2)
        assert client.result(goal) == (SUCCEEDED, [0, 1])
        client.peer.until(lambda: client.result(goal)[0] == UNKNOWN, "it never expires")
        assert scene.judge.of("result")[-1]["status"] == "unknown"
        scene.adapter.ends_well()


def test_feedback_at_500_hz_comes_whole_where_it_is_only_logged(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal")) as scene:
        scene.server(0.002)
        client = scene.client()
        client.meet()
        goal = client.goal(499)
        assert client.result(goal)[0] == SUCCEEDED
        client.peer.until(lambda: len(client.heard[hex_of(goal)]) == 499, "not all has come")
        assert client.heard[hex_of(goal)] == list(range(499))
        feedback = eventually(
            lambda: [e for e in scene.judge.of("feedback") if e["goal_id"] == hex_of(goal)],
            lambda found: len(found) == 499,
        )
        assert not any(event.get("lost") for event in feedback)
        scene.adapter.ends_well()


def test_who_can_act_past_the_monitor_is_told(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal")) as scene:
        scene.server()
        past = scene.client("/fib")
        text = "/peer can call /fib/_action/send_goal past the monitor"
        eventually(lambda: scene.judge.reports.get("/fib goal", ""), lambda found: text in found)
        past.leave()
        eventually(lambda: scene.judge.reports["/fib goal"], lambda found: not found)
        scene.adapter.ends_well()


@pytest.mark.parametrize(("kind", "service"), [("CancelGoal", "cancel_goal"), ("GetResult", "get_result")])
def test_who_can_only_cancel_or_get_results_past_the_monitor_is_told(kind: str, service: str, tmp_path: Path) -> None:
    """As where one of an action's five names is not remapped, each by itself before Kilted."""
    types = {"CancelGoal": action_srvs.CancelGoal, "GetResult": test_msgs.Fibonacci.Impl.GetResultService}
    with acting(tmp_path, streams("goal")) as scene:
        pilot = scene.scene.peer("pilot")
        client = pilot.node.create_client(types[kind], f"/fib/_action/{service}")
        text = f"/pilot can call /fib/_action/{service} past the monitor"
        eventually(lambda: scene.judge.reports.get("/fib goal", ""), lambda found: text in found)
        pilot.node.destroy_client(client)
        eventually(lambda: scene.judge.reports["/fib goal"], lambda found: text not in found)
        scene.adapter.ends_well()


def test_a_denied_result_that_does_not_fit_ends_the_adapter(tmp_path: Path) -> None:
    wrong = described("/fib", "goal", "test_msgs/action/Fibonacci", proxy="/fib_mon", denied_result={"code": 1})
    with pytest.raises(AssertionError, match="code: Fibonacci_Result has no such field"), acting(tmp_path, [wrong]):
        pass


def test_who_hears_asked_feedback_past_the_monitor_is_told_while_nobody_hears_what_passes(tmp_path: Path) -> None:
    with acting(tmp_path, streams("feedback")) as scene:
        peer = scene.scene.peer("pilot")
        peer.record(test_msgs.Fibonacci.Impl.FeedbackMessage, "/fib/_action/feedback")
        text = "nobody hears /fib_mon/_action/feedback, and past the monitor hears /fib/_action/feedback: /pilot"
        eventually(lambda: scene.judge.reports.get("/fib goal", ""), lambda told: text in told)
        peer.record(test_msgs.Fibonacci.Impl.FeedbackMessage, "/fib_mon/_action/feedback")
        eventually(lambda: scene.judge.reports["/fib goal"], lambda told: text not in told)


def test_who_hears_feedback_that_is_not_asked_about_is_not_told(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal")) as scene:
        peer = scene.scene.peer("pilot")
        peer.record(test_msgs.Fibonacci.Impl.FeedbackMessage, "/fib/_action/feedback")
        text = "nobody serves /fib"  # which is told later than it would be
        eventually(lambda: scene.judge.reports.get("/fib goal", ""), lambda told: told == text)
