"""Services as they are called: where the master has them, or where it last had them."""

from __future__ import annotations

from typing import Any, Tuple

import rospy

from oracle_ros1.graph import ASK_WITHIN, master_proxy

UNCONNECTED = "unable to connect to service"
"""How rospy's error begins where nobody answers, or who serves it has another definition of its type."""


class Unreached(rospy.ServiceException):  # type: ignore[misc] # rospy has no types
    """The service has not got a call."""


class CalledService:
    """A service that goes on to be called while the master is away, or once one was started that does not know it.

    So do clients of it that keep a connection, as those in C++ may.
    """

    def __init__(self, name: str, service_type: Any) -> None:
        """Ask nobody yet; ROS's remaps hold for the name."""
        self._name, self._type = name, service_type
        self._known = ""  # where the master last had it

    def call(self, request: Any) -> Any:
        """Its response; raises `ServiceException`, and `Unreached` where it has not got the call."""
        address, why = self._address()
        caller = rospy.ServiceProxy(self._name, self._type)
        caller._get_service_uri = lambda _: address  # noqa: SLF001 - rospy would wait for a master that hangs
        try:
            return caller(request)
        except rospy.ServiceException as error:
            if str(error).startswith(UNCONNECTED):
                raise Unreached(why or str(error)) from error  # `why`: it has gone, or is elsewhere
            raise

    def _address(self) -> Tuple[str, str]:
        """Where it is, and why that may not be so, empty where the master says it."""
        try:
            code, _, address = master_proxy(ASK_WITHIN).lookupService(self._name)
        except Exception:  # noqa: BLE001 - no master, or a reply that can't be read
            why = "unable to contact master"
        else:
            if code == 1:
                self._known = str(address)
                return self._known, ""
            why = f"service [{rospy.resolve_name(self._name)}] unavailable"
        if not self._known:
            raise Unreached(why)
        return self._known, why
