"""Alarms as signed HTTP requests: each receiver has a thread of its own, and a queue with an end.

They are signed as Standard Webhooks are: HMAC-SHA256 of the id, the time and the body, in base64.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import hmac
import secrets
import socket
import ssl
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import httpx
import structlog

from oracle_server.process.seldom import Seldom
from oracle_server.remote.receivers import Receiver
from oracle_server.wire.json import encode_bytes

MOST = 1_000
"""Alarms that wait for one receiver; more are dropped."""
BACKOFF = (1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 60.0)
"""Seconds before each further try of an alarm; then it is dropped."""
_WITHIN = 10.0
"""Seconds for each part of one try; the answer is one of them."""
_STOP_WITHIN = 2.0
_TRY_AGAIN = (408, 425, 429)
"""Answers below 500 after which an alarm may be taken later."""
_SUCCESS = range(200, 300)
_ERRORS = 500

Alarm = Mapping[str, Any]
"""What happened, as plain data; `alarm` says what of."""

log = structlog.get_logger()


class Webhooks:
    """All receivers of a server. `send` never waits; the rest is done in threads."""

    def __init__(self, receivers: Sequence[Receiver], backoff: Sequence[float] = BACKOFF) -> None:
        """Begin to send to receivers; `backoff` are the seconds before each further try."""
        tls = _trusting()
        self._couriers = [_Courier(receiver, backoff, tls) for receiver in receivers]

    def wants(self, what: str) -> bool:
        """Whether anybody is told of such alarms."""
        return any(what in courier.receiver.what for courier in self._couriers)

    def send(self, alarm: Alarm) -> None:
        """Queue an alarm for those who are told of such; returns at once."""
        for courier in self._couriers:
            if alarm["alarm"] in courier.receiver.what:
                courier.add(alarm)

    @property
    def sent(self) -> int:
        """How many alarms receivers have taken."""
        return sum(courier.sent for courier in self._couriers)

    @property
    def dropped(self) -> int:
        """How many alarms reached a receiver never: too many waited, it refused them, or was away for long."""
        return sum(courier.dropped for courier in self._couriers)

    @property
    def waiting(self) -> int:
        """How many alarms wait to be sent."""
        return sum(courier.waiting for courier in self._couriers)

    def close(self) -> None:
        """Stop, after a moment for what is being sent; what waits is lost, and logged. Call it off the event loop."""
        for courier in self._couriers:
            courier.stop()
        deadline = time.monotonic() + _STOP_WITHIN
        for courier in self._couriers:
            courier.end(max(0.0, deadline - time.monotonic()))


class _Queued(NamedTuple):
    id: str
    """The same in each try."""
    alarm: Alarm


class _Courier:
    """Brings alarms to one receiver, in their order."""

    def __init__(self, receiver: Receiver, backoff: Sequence[float], tls: ssl.SSLContext) -> None:
        self.receiver, self._tls = receiver, tls
        self.sent = self.dropped = 0
        self._backoff = backoff
        self._queue: deque[_Queued] = deque()
        self._changed, self._stopped = threading.Condition(), threading.Event()
        self._seldom = Seldom()
        self._away = False
        """Whether the last try failed, and the alarm waits for the next one."""
        self._thread = threading.Thread(target=self._run, name="alarms", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        return len(self._queue)

    def add(self, alarm: Alarm) -> None:
        with self._changed:
            if len(self._queue) >= MOST:
                self._drop(f"more than {MOST} wait")
                return
            self._queue.append(_Queued(f"msg_{secrets.token_hex(12)}", alarm))
            self._changed.notify()

    def stop(self) -> None:
        self._stopped.set()
        with self._changed:
            self._changed.notify()

    def end(self, within: float) -> None:
        self._thread.join(within)
        if self._queue:
            count = len(self._queue)
            log.warning("alarms are not sent any more: the server stops", receiver=self.receiver.host, count=count)

    def _run(self) -> None:
        waiting = _Waiting()
        with httpx.Client(timeout=_WITHIN, follow_redirects=False, trust_env=False, verify=self._tls) as http:
            while True:
                with self._changed:
                    while not self._queue and not self._stopped.is_set():
                        self._changed.wait()
                    if not self._queue:
                        return
                    queued = self._queue[0]
                reason = self._bring(http, waiting, queued)
                if reason is None and self._stopped.is_set():
                    return
                with self._changed:
                    self._queue.popleft()
                    if reason:
                        self._drop(reason)
                    else:
                        self.sent += 1

    def _bring(self, http: httpx.Client, waiting: _Waiting, queued: _Queued) -> str | None:
        """Send an alarm until it is taken; why it is given up, empty where it was taken, None where this must stop."""
        body = encode_bytes({"id": queued.id, **queued.alarm})
        reason = ""
        for wait in (*self._backoff, None):
            reason, again = _attempt(http, waiting, self.receiver, queued, body)
            self._note(reason, again)
            if not reason:
                return ""
            if not again or wait is None:
                return reason
            if self._stopped.wait(wait):
                return None
        return reason

    def _note(self, reason: str, again: bool) -> None:
        """Log it where a receiver begins not to take alarms, minutes before the first is dropped, and where it ends."""
        if again and not self._away:
            where = self.receiver.host
            log.warning("alarms do not arrive now; they wait, and are tried again", receiver=where, reason=reason)
        elif self._away and not reason:
            log.info("alarms arrive again", receiver=self.receiver.host)
        self._away = again or (self._away and bool(reason))

    def _drop(self, reason: str) -> None:
        self.dropped += 1
        if count := self._seldom.due("dropped"):
            where, in_all = self.receiver.host, self.dropped
            log.warning("alarms are dropped", receiver=where, reason=reason, count=count, in_all=in_all)


class _Waiting:
    """Waits for answers so long and no longer: httpx counts from the last byte on, and they may come one by one."""

    def __init__(self) -> None:
        self.in_vain = False
        self._socket: socket.socket | None = None
        self._timer = threading.Timer(0, self._cut)

    def __call__(self, event: str, info: Mapping[str, Any]) -> None:
        """Note what a client does, as it is told by the extension `trace`."""
        if event in ("connection.connect_tcp.complete", "connection.start_tls.complete"):
            self._socket = info["return_value"].get_extra_info("socket")
        elif event == "http11.receive_response_headers.started":
            self._timer = threading.Timer(_WITHIN, self._cut)
            self._timer.daemon = True
            self._timer.start()
        elif event.startswith("http11.receive_response_headers."):
            self._timer.cancel()

    def _cut(self) -> None:
        self.in_vain = True
        if self._socket is not None:
            with contextlib.suppress(OSError):
                socket.socket.shutdown(self._socket, socket.SHUT_RDWR)  # TLS's own would wait for the other side


def _trusting() -> ssl.SSLContext:
    """Trusts the authorities that browsers do, and those of the system or of `SSL_CERT_FILE`, as a company's own."""
    context = httpx.create_ssl_context(trust_env=False)
    context.load_default_certs()
    return context


def _attempt(
    http: httpx.Client, waiting: _Waiting, receiver: Receiver, queued: _Queued, body: bytes
) -> tuple[str, bool]:
    """Send an alarm once; why that failed, empty where it did not, and whether to try again."""
    headers, watched = _headers(receiver, queued, body), {"trace": waiting}
    waiting.in_vain = False
    try:
        with http.stream("POST", receiver.url, content=body, headers=headers, extensions=watched) as response:
            status = response.status_code
    except httpx.HTTPError as error:
        if waiting.in_vain:
            return f"its answer was not whole within {_WITHIN:g} s", True
        return f"{type(error).__name__}: {error}", True
    except Exception as error:  # noqa: BLE001 -- whatever a receiver answers, the next alarm is to be sent
        return f"{type(error).__name__}: {error}", False
    if status in _SUCCESS:
        return "", False
    return f"it answered {status}", status >= _ERRORS or status in _TRY_AGAIN


def _headers(receiver: Receiver, queued: _Queued, body: bytes) -> dict[str, str]:
    at = int(time.time())  # of this try: receivers refuse what is some minutes old, since it may be a replay
    signed = b"%s.%d.%s" % (queued.id.encode(), at, body)
    digest = base64.b64encode(hmac.new(receiver.secret, signed, hashlib.sha256).digest()).decode()
    return {
        "Content-Type": "application/json",
        "User-Agent": "oracle-server",
        "webhook-id": queued.id,
        "webhook-timestamp": str(at),
        "webhook-signature": f"v1,{digest}",
    }
