"""Two threads that offer and write while the library logs of a client; that takes long, as on a busy machine.

Python may run another thread while a line is logged. That one must not wait for what the library has locked meanwhile.
"""

from __future__ import annotations

import json
import logging
import sys
import threading
import time

from websockets.sync.client import connect
from websockets.typing import Subprotocol

from oracle_server.foxglove.channels import Channel, Message
from oracle_server.foxglove.listening import Listening
from oracle_server.foxglove.schemas import LOG

CLIENT = "foxglove.websocket.connected_client"
WRITES, OFFERS, ASKS = 3_000, 500, 20


def slowly(_: logging.LogRecord) -> bool:
    """Let others run while something is logged."""
    time.sleep(0.2)  # waits for nothing: it is how long the line takes
    return True


def main(what: str) -> None:
    logging.basicConfig(level=logging.INFO)
    listening = Listening("127.0.0.1", 0)
    for name in (CLIENT, f"{CLIENT}.send_lossy"):
        logging.getLogger(name).addFilter(slowly)
    channel = Channel("/a", LOG, {})
    offered = listening.offer(channel)
    message = Message(channel, 1, 1, 1, {"text": "x" * 20_000})
    url = f"ws://127.0.0.1:{listening._server.port}"
    protocols = [Subprotocol("foxglove.sdk.v1")]
    with connect(url, subprotocols=protocols, proxy=None, max_queue=1, ping_interval=None, close_timeout=0.1) as socket:

        def ask(number: int) -> None:
            subscriptions = [{"id": number, "channelId": number}]
            socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

        def ask_for_others() -> None:
            for number in range(ASKS):
                ask(2**30 + number)

        def write() -> None:
            for _ in range(WRITES):
                offered.write(message)

        def offer() -> None:
            for _ in range(OFFERS):
                listening.withdraw(listening.offer(channel))

        if what == "slow":
            ask(offered.number)
            works = [write, write]
        else:
            works = [offer, ask_for_others]
        threads = [threading.Thread(target=work) for work in works]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        listening.close()
        print("done", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
