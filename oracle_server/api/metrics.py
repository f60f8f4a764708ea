"""`/metrics` for Prometheus. The number of series is bounded: no label has sessions or topics as values."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from fastapi import Request, Response
from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from oracle_server.api.packing import packed_answer
from oracle_server.api.routes import Routes
from oracle_server.core.judging.asked import unasked
from oracle_server.core.tally import BOUNDS
from oracle_server.core.verdicts import Outcome
from oracle_server.edge.access import demand_all
from oracle_server.edge.scopes import needs
from oracle_server.history.port import History, Writing
from oracle_server.jobs.forwarding import Progress
from oracle_server.process.watchdog import Watchdog
from oracle_server.remote.webhooks import Webhooks
from oracle_server.sessions.counters import DECISION_BOUNDS
from oracle_server.sessions.registry import Registry

_SESSION_COUNTERS = {
    "late": "Events older than an event judged before",
    "skewed": "Events stamped too far ahead of their arrival",
    "skipped": "Events that were not judged: late, or while the history could not be written",
    "lost": "Events that never arrived",
    "duplicates": "Events that were received again",
    "denied": "Events that were denied",
    "refused": "Events that could not be read, or of an unknown stream",
    "revised": "Revisions of verdicts, by events that came late",
    "retracted": "Violations that do not stand, by events that came late",
    "engine_failures": "Engines that failed and judge no further events",
}
_NEGATIVE = (Outcome.FALSE, Outcome.CURRENTLY_FALSE)
Pairs = Mapping[tuple[str, str], int]
"""Numbers by spec and property."""
_CONTENT = "text/plain; version=0.0.4; charset=utf-8"


def router(
    registry: Registry, history: History, watchdog: Watchdog, webhooks: Webhooks | None, forwarding: Progress | None
) -> Routes:
    """The route of the metrics."""
    collector = ServerCollector(registry, history, watchdog, webhooks, forwarding)
    routes = Routes(tags=["health"])

    @routes.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
    @needs("read")
    async def metrics(request: Request) -> Response:
        """The server's numbers, for Prometheus; not for a token that is bound to some specs or sessions."""
        demand_all(request)
        families, counts = [*collector.collect()], dict(registry.counters.violated.counts)
        present = await _at_present(registry)
        answer = await packed_answer(request, history, partial(_rendered, families, counts, *present))
        answer.headers["Content-Type"] = _CONTENT
        return answer

    return routes


async def _at_present(registry: Registry) -> tuple[Pairs, Pairs, Pairs]:
    """In how many open sessions each property does not hold at present, has an open episode, and was asked nothing."""
    violated, episodes, idle = Counter[tuple[str, str]](), Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    pair = registry.counters.violated.pair
    for session in [*registry.open.values()]:
        told = next(iter(session.core.judges.values())).told
        violated.update(pair(session.spec.id, s.property.id) for s in told.properties if s.outcome in _NEGATIVE)
        idle.update(pair(session.spec.id, s.property.id) for s in told.properties if unasked(s.watch, s.outcome))
        episodes.update(pair(session.spec.id, told.properties[i].property.id) for i, _ in told.following.open)
        await asyncio.sleep(0)  # so that decisions wait for one session, not for a thousand
    return violated, episodes, idle


def _rendered(families: list[Metric], counts: Pairs, violated: Pairs, episodes: Pairs, idle: Pairs) -> bytes:
    """All metrics as text; in a thread, since there may be thousands of lines."""
    labels = ["spec", "property"]
    total = CounterMetricFamily("oracle_violations", "Verdicts at which a property became negative", labels=labels)
    now = "Open sessions in which a property does not hold at present"
    present = GaugeMetricFamily("oracle_violated", now, labels=labels)
    going = GaugeMetricFamily("oracle_episodes_open", "Open sessions in which an episode is open", labels=labels)
    what = "Open sessions in which nothing was asked of a property yet"
    waiting = GaugeMetricFamily("oracle_unasked", what, labels=labels)
    for pair, count in counts.items():
        total.add_metric(pair, count)
        present.add_metric(pair, violated.get(pair, 0))
        going.add_metric(pair, episodes.get(pair, 0))
        waiting.add_metric(pair, idle.get(pair, 0))
    collectors = CollectorRegistry()
    collectors.register(_Made([*families, total, present, going, waiting]))
    ProcessCollector(registry=collectors)
    return generate_latest(collectors)


class _Made(Collector):
    """Metrics that were collected before."""

    def __init__(self, families: list[Metric]) -> None:
        self._families = families

    def collect(self) -> Iterator[Metric]:
        """These metrics."""
        return iter(self._families)


class ServerCollector:
    """Collects the metrics of one server, those by property aside."""

    def __init__(
        self, registry: Registry, history: Writing, watchdog: Watchdog, webhooks: Webhooks | None = None,
        forwarding: Progress | None = None,
    ) -> None:  # fmt: skip
        self._forwarding = forwarding
        self._registry, self._history, self._watchdog, self._webhooks = registry, history, watchdog, webhooks

    def collect(self) -> Iterator[Metric]:
        """All metrics, with their present values."""
        yield from self._counted()
        yield from self._present()
        if self._forwarding is not None:
            yield from _forwarded(self._forwarding)
        counters, sessions = self._registry.counters, list(self._registry.open.values())
        held = counters.total_holds([session.core.holds for session in sessions])
        yield _histogram("hold", "How long events were held in the order", BOUNDS, held.buckets, held.total)
        times = counters.decisions
        yield _histogram(
            "decision", "From an event's arrival to its decision", DECISION_BOUNDS, times.buckets, times.total
        )

    def _counted(self) -> Iterator[Metric]:
        counters = self._registry.counters
        yield CounterMetricFamily("oracle_events", "Events judged or skipped, in each order", counters.steps)
        verdicts = CounterMetricFamily("oracle_verdicts", "Verdicts, by outcome", labels=["outcome"])
        for outcome, count in counters.outcomes.items():
            verdicts.add_metric([outcome.value], count)
        yield verdicts
        counts = counters.total_counts([session.counts() for session in self._registry.open.values()])
        for name, what in _SESSION_COUNTERS.items():
            yield CounterMetricFamily(f"oracle_{name}", what, counts[name])
        yield CounterMetricFamily("oracle_throttled", "Pauses of monitors that sent too fast", counters.throttled)
        yield CounterMetricFamily("oracle_attachments", "Connections on which a monitor attached", counters.attachments)
        yield CounterMetricFamily("oracle_undrawn", "Steps not sent to Foxglove, since it was behind", counters.undrawn)
        sent, dropped = (self._webhooks.sent, self._webhooks.dropped) if self._webhooks else (0, 0)
        yield CounterMetricFamily("oracle_alarms_sent", "Alarms that a receiver has taken", sent)
        yield CounterMetricFamily("oracle_alarms_dropped", "Alarms that did not reach a receiver", dropped)
        yield CounterMetricFamily("oracle_stalls", "Stalls of the event loop", self._watchdog.stalls)

    def _present(self) -> Iterator[Metric]:
        sessions = self._registry.open.values()
        outboxes = [m.outbox for s in sessions for m in s.monitors.values() if m.outbox]
        depths = GaugeMetricFamily("oracle_queue_depth", "Entries that wait, by queue", labels=["queue"])
        depths.add_metric(["order"], sum(len(s.core.buffer) for s in sessions))
        depths.add_metric(["history"], self._history.pending)
        depths.add_metric(["alarms"], self._webhooks.waiting if self._webhooks else 0)
        depths.add_metric(["monitors"], sum(getattr(outbox, "queued", 0) for outbox in outboxes))
        yield depths
        yield GaugeMetricFamily("oracle_sessions", "Open sessions", len(sessions))
        idle = sum(s.presence.is_idle(s.clock.now()) for s in sessions)
        yield GaugeMetricFamily("oracle_sessions_idle", "Open sessions without a monitor for 10 minutes", idle)
        troubled = sum(s.keeping.trouble is not None for s in sessions) + len(self._registry.unrestored)
        what = "Sessions that are not judged: restoring them failed, or nothing more of them can be kept"
        yield GaugeMetricFamily("oracle_sessions_in_trouble", what, troubled)
        yield GaugeMetricFamily("oracle_monitors", "Monitors that are connected", len(outboxes))
        yield GaugeMetricFamily("oracle_history_lag_seconds", "Age of the oldest row not committed", self._history.lag)
        writable = self._history.failure is None and self._history.read_only is None
        yield GaugeMetricFamily("oracle_history_writable", "Whether the history can be written", int(writable))


def _forwarded(progress: Progress) -> Iterator[Metric]:
    """How the forwarding to a centre goes. What is not known yet has no sample."""
    yield CounterMetricFamily("oracle_forward_rows", "Rows that were brought to the centre", progress.rows)
    what = "Steps that were deleted before they were brought to the centre"
    yield CounterMetricFamily("oracle_forward_lost", what, progress.lost)
    reached = progress.left is not None and progress.trouble is None
    yield GaugeMetricFamily("oracle_forward_reached", "Whether the centre takes what is brought", int(reached))
    if progress.left is not None:
        what = "Rows still to be brought to the centre"
        yield GaugeMetricFamily("oracle_forward_rows_left", what, progress.left)
        lag = 0.0 if progress.oldest is None else max(0.0, time.time() - progress.oldest / 1e9)
        yield GaugeMetricFamily("oracle_forward_lag_seconds", "Age of the oldest step that is not there", lag)


def _histogram(name: str, what: str, bounds: Sequence[int], buckets: Sequence[int], total: int) -> Metric:
    """A histogram in seconds of times in nanoseconds."""
    ends = [*(str(bound / 1e9) for bound in bounds), "+Inf"]
    below = [sum(buckets[: i + 1]) for i in range(len(ends))]
    family = HistogramMetricFamily(f"oracle_{name}_seconds", what)
    family.add_metric([], list(zip(ends, below, strict=True)), total / 1e9)
    return family
