"""Streams by the names that they have on a robot of a fleet."""

from __future__ import annotations

import pytest
from oracle_adapter import Names


def test_names_stay_where_nothing_is_said() -> None:
    names = Names()
    assert names["/battery"] == "/battery"
    assert names["battery"] == "/battery"


def test_a_remap_takes_the_proxy_along() -> None:
    names = Names(["/SetLED:=/uav1/set_led"])
    assert names["/SetLED"] == "/uav1/set_led"
    assert names["/SetLED_mon"] == "/uav1/set_led_mon"
    assert names["/battery"] == "/battery"


def test_a_proxy_can_be_remapped_by_itself() -> None:
    names = Names(["/SetLED:=/uav1/set_led", "/SetLED_mon:=/checked"])
    assert (names["/SetLED"], names["/SetLED_mon"]) == ("/uav1/set_led", "/checked")


def test_a_namespace_goes_before_all_but_what_is_remapped() -> None:
    names = Names(["/clock_source:=/clock_source"], namespace="uav1/")
    assert names["/battery"] == "/uav1/battery"
    assert names["/battery_mon"] == "/uav1/battery_mon"
    assert names["/clock_source"] == "/clock_source"


def test_what_the_spec_does_not_have_is_told() -> None:
    names = Names(["/a:=/b", "/a_mon:=/c", "/typo:=/d"])
    assert list(names.unused(["/a", "/e"])) == ["/typo"]


@pytest.mark.parametrize(
    "remap", ["", "/a", "/a:=", ":=/b", "/a=/b", "/a:=/b c", "/a:=/b:=/c", "/a/:=/b", "/1:=/b"]
)
def test_what_is_no_remap_is_refused(remap: str) -> None:
    with pytest.raises(ValueError, match=r"is no remap like /battery:=/uav1/battery"):
        Names([remap])


def test_a_name_has_one_target() -> None:
    with pytest.raises(ValueError, match="/a is remapped twice"):
        Names(["/a:=/b", "/a:=/c"])
    assert Names(["/a:=/b", "a:=/b"])["/a"] == "/b"


@pytest.mark.parametrize("namespace", ["uav 1", "/1", "/a//b", "~"])
def test_what_is_no_namespace_is_refused(namespace: str) -> None:
    with pytest.raises(ValueError, match="is no namespace like /uav1"):
        Names(namespace=namespace)
