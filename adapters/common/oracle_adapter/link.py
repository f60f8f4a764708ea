"""The link: what an adapter calls."""

from __future__ import annotations

from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Callable, Dict, Literal, Optional, TypedDict, Union
from uuid import uuid4

from oracle_adapter.connection import Timing, addresses_of
from oracle_adapter.exchange import Exchange
from oracle_adapter.jsonvalues import dumps
from oracle_adapter.keeper import Keeper
from oracle_adapter.protocol import Hello, Protocol

if TYPE_CHECKING:
    from ssl import SSLContext
    from types import TracebackType
    from typing import Iterable, Mapping, Type

    from typing_extensions import Unpack

    from oracle_adapter.decision import Answer, Why
    from oracle_adapter.errors import LinkError
    from oracle_adapter.exchange import Stamp, State, Then
    from oracle_adapter.marks import ClockStamp
    from oracle_adapter.notices import Attached
    from oracle_adapter.protocol import TimeSource
    from oracle_adapter.stats import Stats


class Details(TypedDict, total=False):
    """What else may be known of an event."""

    source: Optional[str]
    """Its publisher; of a name longer than events may have only the beginning."""
    call: Optional[int]
    """Pairs a request with its response, and a goal with its reply."""
    goal_id: Optional[str]
    """The goal that an event of an action is about; empty for a cancel of all."""
    status: Optional[str]
    """How that goal stands, as `accepted`, with a reply, a result or a status."""
    lost: Optional[int]
    """Counts messages known to be missed just before it."""


_LONGEST = 1000
"""The most characters of what is reported of a stream."""
_LONGEST_SOURCE = 255
"""The most characters of an event's source."""


class Link:
    """A monitor's link to the oracle, kept up by a thread of its own from `start` to `close`.

    `url`: of several servers over one history all, separated by commas; they are tried in turn.
    `session`: without one the server makes one. `streams`: names of those that will be observed,
    default all. `capacity`: events held until the server has committed them; more than its order
    holds, or events are lost here before the server makes room. `tls`: default, for an encrypted
    address, by `ORACLE_CA`, `ORACLE_CLIENT_CERT` and `ORACLE_CLIENT_KEY`. `features`: what the
    adapter can do that not every adapter can, by the server's words, as `actions`.

    `on_violation(record)`, `on_episode(frame)`, `on_revision(record)`, `on_verdicts(frame)`,
    `on_state(state, detail)`, `on_error(error)` are called in the link's thread, as the futures'
    callbacks are: they must be quick, and must neither wait for an answer nor close the link.
    `on_verdicts` gets the state of the properties, once attached and whenever it changes;
    `on_revision` what stands otherwise than was said, because of what came late. Who has
    `on_episode` is told of episodes, violations that follow each other closely, in place of each
    violation, unless the server is older. Errors that no `on_error` takes are logged.
    """

    def __init__(
        self,
        url: str,
        monitor: str,
        *,
        spec: Optional[str] = None,
        session: Optional[str] = None,
        streams: Optional[Iterable[str]] = None,
        clock: Literal["wall", "sim"] = "wall",
        token: Optional[str] = None,
        tls: Optional[SSLContext] = None,
        capacity: int = 20_000,
        features: Iterable[str] = (),
        timing: Optional[Timing] = None,
        on_violation: Optional[Callable[[Mapping[str, Any]], None]] = None,
        on_state: Optional[Callable[[State, str], None]] = None,
        on_error: Optional[Callable[[LinkError], None]] = None,
        on_verdicts: Optional[Callable[[Mapping[str, Any]], None]] = None,
        on_revision: Optional[Callable[[Mapping[str, Any]], None]] = None,
        on_episode: Optional[Callable[[Mapping[str, Any]], None]] = None,
    ) -> None:
        names = None if streams is None else tuple(streams)
        wanted = True if on_verdicts else None
        told = (("revisions", on_revision), ("episodes", on_episode))
        wishes = (*features, *(name for name, callback in told if callback)) or None
        hello = Hello(monitor, uuid4().hex, session, spec, names, clock, wanted, wishes)
        protocol = Protocol(hello, capacity)
        self._exchange = Exchange(
            protocol, on_violation, on_state, on_error, on_verdicts, on_revision, on_episode
        )
        addresses = addresses_of(url, token, tls)
        self._keeper = Keeper(addresses, timing or Timing(), self._exchange)

    def start(self) -> None:
        """Begin to connect, and return at once. A link starts once.

        Raises `LinkError` where the link's thread can't be made, or is not ready within 10 s.
        """
        self._keeper.start()

    def wait_attached(self, timeout: Optional[float] = None) -> Attached:
        """Wait up to `timeout` seconds for a connection; raises `LinkError` where none comes.

        None: until there is one, or the link is over. A link that was not started is an error.
        """
        return self._exchange.wait_attached(timeout)

    @property
    def attached(self) -> Optional[Attached]:
        """What the server answered on the connection that there is; None without one."""
        return self._exchange.attached

    def send(
        self, stream: str, kind: str, stamp: Stamp, data: Any, **more: Unpack[Details]
    ) -> bool:
        """Queue an event, never waiting; False where it was not queued and is counted as lost.

        `stamp` is the publication time in ns, None where there is none, or a function that returns
        it; this is called under the lock, where it must not use the link.
        """
        body = _body(stream, kind, data, ask=False, **more)
        return self._exchange.send(stamp, body, more.get("lost") or 0)

    def ask(
        self,
        stream: str,
        kind: str,
        stamp: Stamp,
        data: Any,
        *,
        decide_within: float,
        **more: Unpack[Details],
    ) -> Future[Answer]:
        """Queue an event that wants a decision, never waiting.

        The future has its answer within `decide_within` seconds, whatever happens; it can't be
        cancelled.
        """
        answered: Future[Answer] = Future()
        answered.set_running_or_notify_cancel()  # it can't be cancelled any more
        then = answered.set_result
        self.ask_then(stream, kind, stamp, data, then, decide_within=decide_within, **more)
        return answered

    def ask_then(
        self,
        stream: str,
        kind: str,
        stamp: Stamp,
        data: Any,
        then: Then,
        *,
        decide_within: float,
        **more: Unpack[Details],
    ) -> None:
        """Ask without a future: `then` is called with the answer.

        That happens in the link's thread; in the caller's where the answer is known at once.
        """
        body = _body(stream, kind, data, ask=True, **more)
        self._exchange.ask(stamp, body, more.get("lost") or 0, decide_within, then)

    def lost(self, count: int) -> bool:
        """Have the next event, of whatever stream, tell that so many could not be read.

        True where events are lost that none has told yet: it may never come.
        """
        return self._exchange.miss(count)

    def handled(self, answer: Answer, passed: bool, why: Why) -> None:
        """Report what was done with an ask; nothing where its event was never queued."""
        self._exchange.handled(answer, passed, why)

    def clock(
        self, stamps: Union[Iterable[ClockStamp], Callable[[], Iterable[ClockStamp]]]
    ) -> None:
        """Announce that nothing older than a stamp (ns) will come of some streams.

        Items are `(stream, kind, stamp)`. They are sent after the events queued so far; of those
        that wait, the latest of a stream replaces the others. A function is called under the lock:
        no event is queued or stamped by a function meanwhile.
        """
        self._exchange.clock(stamps)

    def renew(self, stamps: Callable[[], Iterable[ClockStamp]]) -> None:
        """Simulated time went back: end the session, and continue in the next one.

        What was queued so far belongs to the session that ends, what is queued from now on to the
        next. `stamps` is as for `clock`, and returns the new time.
        """
        self._exchange.renew(stamps)

    def report(
        self,
        stream: str,
        kind: str,
        *,
        time_source: Optional[TimeSource] = None,
        trouble: Optional[str] = None,
        bypass: Optional[str] = None,
    ) -> None:
        """Report to the server where a stream's times come from, or what is wrong with it.

        `bypass` is what of that lets events past the monitor, so that the verdicts on them may be
        wrong. What is not given stays as last reported; an empty text means that there is nothing.
        """
        given = {"time_source": time_source, "trouble": trouble, "bypass": bypass}
        facts = {name: value[:_LONGEST] for name, value in given.items() if value is not None}
        self._exchange.describe(stream, kind, facts)

    def stats(self) -> Stats:
        """The counters, as they are now."""
        return self._exchange.stats()

    def close(self, timeout: float = 5.0) -> bool:
        """Write what is queued, detach, and end the thread; after `timeout` seconds end it without.

        True where the server has confirmed, after judging all. What is asked or sent from now on is
        lost; asks without an answer get theirs here and now, as unavailable, so that what was
        done with them is reported.
        """
        return self._keeper.stop(timeout)

    def __enter__(self) -> Link:
        self.start()
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()


def _body(
    stream: str,
    kind: str,
    data: Any,
    *,
    ask: bool,
    source: Optional[str] = None,
    call: Optional[int] = None,
    goal_id: Optional[str] = None,
    status: Optional[str] = None,
    lost: Optional[int] = None,  # noqa: ARG001 - passed separately
) -> str:
    """An event's JSON after its number, stamp and losses, which are known only later."""
    event: Dict[str, Any] = {"stream": stream, "kind": kind, "ask": ask}
    source = source and source[:_LONGEST_SOURCE]
    details = {"source": source, "call": call, "goal_id": goal_id, "status": status}
    event.update((name, value) for name, value in details.items() if value is not None)
    event["data"] = data
    return dumps(event)[1:]
