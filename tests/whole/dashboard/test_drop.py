"""Recordings that are given to the dashboard."""

from __future__ import annotations

import json
import os
import signal
from base64 import b64encode
from pathlib import Path

import pytest
from playwright.async_api import Page, expect
from rosbags.rosbag2 import StoragePlugin

from tests.replay.judging import write_numbers
from tests.replay.test_folders import SPEC as NUMBERS
from tests.replay.test_folders import TOPICS
from tests.whole.conftest import Starts
from tests.whole.harness import Server
from tests.whole.test_recordings import children, lines, log, send

_DROP = """async ([name, text]) => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([text], name));
  for (const type of ["dragenter", "dragover", "drop"]) {
    document.body.dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: transfer }));
  }
}"""

_DROP_MANY = """async (files) => {
  const transfer = new DataTransfer();
  for (const [name, text] of files) {
    transfer.items.add(new File([Uint8Array.from(atob(text), (each) => each.charCodeAt(0))], name));
  }
  document.body.dispatchEvent(new DragEvent("drop", { bubbles: true, cancelable: true, dataTransfer: transfer }));
}"""


async def test_a_recording_is_dropped_and_its_session_opened(server: Server, page: Page) -> None:
    text = "".join(f"{json.dumps(line)}\n" for line in lines(100))
    await page.goto(f"{server.url}/")
    await page.get_by_label("spec that judges the recording").select_option("single")
    await page.evaluate(_DROP, ["flight <b>1</b>.jsonl", text])
    row = page.locator(".recordings li").first
    await expect(row).to_contain_text("flight <b>1</b>.jsonl by single: 100 events, violations")
    await row.get_by_role("link").click()
    await expect(page.get_by_text("judged to its end.", exact=False).first).to_be_visible()
    await expect(page.locator("strong.closed")).to_contain_text("recording")


@pytest.mark.parametrize("way", ["chosen", "dropped"])
async def test_the_folder_of_a_bag_is_judged_whole(start: Starts, page: Page, tmp_path: Path, way: str) -> None:
    (tmp_path / "specs" / "numbers.yaml").write_text(NUMBERS, encoding="utf-8")
    bag = write_numbers(tmp_path / "run 3", TOPICS, StoragePlugin.MCAP)
    server = start(ORACLE_HISTORY="memory")
    await page.goto(f"{server.url}/")
    await page.get_by_label("spec that judges the recording").select_option("numbers")
    if way == "chosen":
        await page.get_by_label("folder of a bag").set_input_files(bag)
    else:
        files = [[path.name, b64encode(path.read_bytes()).decode()] for path in bag.iterdir()]
        await page.evaluate(_DROP_MANY, files)
    name = "run 3" if way == "chosen" else "bag.tar"
    row = page.locator(".recordings li").first
    await expect(row).to_contain_text(f"{name} by numbers: 20 events, no violation")
    await expect(row.locator(".hint")).to_have_count(0)


async def test_several_files_that_are_no_bag_are_refused(server: Server, page: Page) -> None:
    await page.goto(f"{server.url}/")
    await expect(page.get_by_label("spec that judges the recording")).to_be_visible()
    await page.evaluate(_DROP_MANY, [["a.jsonl", ""], ["b.jsonl", ""]])
    await expect(page.locator(".drop")).to_contain_text("One recording at a time")


async def test_what_can_not_be_judged_is_told(server: Server, page: Page) -> None:
    await page.goto(f"{server.url}/")
    await page.get_by_label("spec that judges the recording").select_option("single")
    await page.evaluate(_DROP, ["photo.jpg", "no recording"])
    await expect(page.locator(".recordings li").first).to_contain_text(
        "photo.jpg by single: incomplete, photo.jpg: is no recording"
    )


async def test_a_recording_is_chosen_by_keyboard_and_cancelled(server: Server, page: Page, tmp_path: Path) -> None:
    await page.goto(f"{server.url}/")
    await page.get_by_label("spec that judges the recording").select_option("single")
    async with page.expect_file_chooser() as choosing:
        await page.get_by_role("button", name="Choose a recording…").press("Enter")
    await (await choosing.value).set_files(log(tmp_path / "long.jsonl", 20_000))
    row = page.locator(".recordings li").first
    await row.get_by_role("button", name="Cancel").press("Enter")
    await expect(row).to_contain_text("incomplete, it was cancelled")


async def test_one_that_is_too_large_is_refused(start: Starts, page: Page, tmp_path: Path) -> None:
    server = start(ORACLE_HISTORY="memory", ORACLE_MAX_RECORDING="1MB")
    await page.goto(f"{server.url}/")
    await page.get_by_label("spec that judges the recording").select_option("single")
    await page.get_by_label("recording", exact=True).set_input_files(log(tmp_path / "large.jsonl", 30_000))
    await expect(page.locator(".drop")).to_contain_text("large.jsonl: ")
    await expect(page.locator(".recordings li")).to_have_count(0)


async def test_what_is_judged_in_part_so_far_is_not_called_good(start: Starts, page: Page, tmp_path: Path) -> None:
    server = start(ORACLE_HISTORY="memory")
    many = 20_000
    sent = send(server, log(tmp_path / "log.jsonl", many, big=many), "single", session="s")
    await server.until(lambda: server.get(f"recordings/{sent['id']}"), lambda one: one["session"] is not None)
    stand = "currently_true"
    await server.until(
        lambda: [p["outcome"] for p in server.get("sessions/s")["properties"]], lambda now: now == [stand]
    )
    (process,) = children(server, "oracle_server.jobs.judging")
    os.kill(process, signal.SIGSTOP)
    await page.goto(f"{server.url}/#/sessions/s")
    card = page.locator(".now .card").first
    await expect(card).to_contain_text("Its property holds so far; the recording is not judged to its end yet")
    await expect(card).to_have_attribute("data-state", "being judged")
    os.kill(process, signal.SIGCONT)
    await expect(card).to_contain_text("1 of 1 fail: a_is_small")
