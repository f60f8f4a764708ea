"""Qualities of service: which to request and which to offer, by those of the other nodes on a topic."""

from __future__ import annotations

from typing import Any, Sequence

from rclpy.qos import (
    DurabilityPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)

try:
    from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
except ImportError:  # in Humble
    from rclpy.qos_event import PublisherEventCallbacks, SubscriptionEventCallbacks

# What does not match is found by looking. Handlers of events would cost each message a third more in rclpy's executor.
NO_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)

DEPTH = 1000
ROOM = 2**28
"""Bytes that a publisher keeps for who is slow, at the most, unless ten messages are larger."""
FOREVER = 2**62  # ns; the graph has a larger number where there is no end


def to_request(offered: Sequence[QoSProfile]) -> QoSProfile:
    """The strictest profile that every publisher offers; reliable and volatile where there is none yet."""
    reliable = all(profile.reliability != ReliabilityPolicy.BEST_EFFORT for profile in offered)
    lasting = offered and all(lasts(profile) for profile in offered)
    return _profile(DEPTH, reliable=reliable, lasting=bool(lasting))


def depth_for(size: int) -> int:
    """How many messages of a size (bytes) a publisher is to keep for who is slow, or hangs."""
    return next((depth for depth in (DEPTH, 100) if depth * size <= ROOM), 10)


def to_offer(offered: Sequence[QoSProfile], depth: int = DEPTH) -> QoSProfile:
    """What the publishers offer, for their messages to be passed on with; of several, the most that one offers.

    How many messages a publisher keeps is not on the graph: of one that keeps some for those who come later, one is
    kept; else `depth` for those who are slow.
    """
    reliable = not offered or any(profile.reliability != ReliabilityPolicy.BEST_EFFORT for profile in offered)
    lasting = any(lasts(profile) for profile in offered)
    times = [_times(profile) for profile in offered]
    common = times[0] if times and all(other == times[0] for other in times) else {}
    return _profile(1 if lasting else depth, reliable=reliable, lasting=lasting, **common)


def lasts(profile: QoSProfile) -> bool:
    """Whether a publisher keeps messages for those who come later."""
    return bool(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)


def leases(profile: QoSProfile) -> bool:
    """Whether a publisher promises to be there, or to be told as gone within a time."""
    return "liveliness_lease_duration" in _times(profile)


def lifespan(offered: Sequence[QoSProfile]) -> float | None:
    """Seconds after which messages are of no use to anybody, as all publishers say; None where one does not."""
    found = [profile.lifespan.nanoseconds for profile in offered]
    return max(found) / 10**9 if found and all(0 < time < FOREVER for time in found) else None


def same(one: QoSProfile, other: QoSProfile) -> bool:
    """Whether two profiles are one to everybody else on the graph."""
    return _times(one) == _times(other) and all(
        getattr(one, name) == getattr(other, name) for name in ("reliability", "durability", "depth")
    )


def misfit(offered: QoSProfile, requested: QoSProfile) -> str:
    """Why a subscription does not match a publisher, both by the graph; empty where it does."""
    compatibility, reason = qos_check_compatible(offered, requested)
    if compatibility != QoSCompatibility.ERROR:
        return ""
    return ", ".join(part.strip().removeprefix("ERROR: ").lower() for part in reason.split(";") if "ERROR" in part)


def _times(profile: QoSProfile) -> dict[str, Any]:
    """What a profile promises about time, where it promises anything."""
    times = {name: getattr(profile, name) for name in ("deadline", "lifespan", "liveliness_lease_duration")}
    promised = {name: time for name, time in times.items() if 0 < time.nanoseconds < FOREVER}
    if profile.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC:
        promised["liveliness"] = profile.liveliness
    return promised


def _profile(depth: int, *, reliable: bool, lasting: bool, **times: Any) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if lasting else DurabilityPolicy.VOLATILE,
        **times,
    )
