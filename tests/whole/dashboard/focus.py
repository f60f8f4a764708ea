"""The focus of the keyboard, as one puts it on what one sees."""

from __future__ import annotations

from playwright.async_api import Locator, expect


async def focus(element: Locator) -> None:
    """Focus an element once it is shown: what is still hidden takes no focus, and says nothing of it."""
    await expect(element).to_be_visible()
    await element.focus()
    await expect(element).to_be_focused()
