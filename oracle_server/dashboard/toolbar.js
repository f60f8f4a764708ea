// The buttons above the timeline, what part of the session is in view in words, and the map of its keys.

import { h, rove, TO_AND_FRO } from "./dom.js";
import { stretch } from "./words.js";

const SPANS = [["10 s", 10e9], ["60 s", 60e9], ["10 min", 600e9]];
const KEYS = [
  ["← →", "move in time"], ["+ −", "zoom"], ["0", "the whole session"], ["l", "follow the newest steps"],
  ["[ ]", "the episode before, and the next one"], ["↑ ↓", "from row to row"], ["Enter", "explain the row"], ["Esc", "close the explanation"],
];

/** Buttons that move `window`, and step through episodes by `step("asc")` and `step("desc")`. */
export function toolbar(window, step) {
  const spans = SPANS.map(([text, span]) => [span, h("button", { onclick: () => window.take(span) }, text)]);
  const live = h("button", { class: "live", onclick: () => window.follow() }, "Live");
  const shown = h("span", { class: "hint shown" });
  const keys = h("div", { id: "keys", class: "keys", popover: "auto" },
    h("dl", {}, KEYS.map(([key, what]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, what)])),
    h("p", {}, "A lane is thin where it holds, tall where it fails, hatched where it is unknown, and dotted beneath"), h("p", {}, "where messages may be missing. A stream's height is its rate; a dashed box is a gap of three periods."));
  const node = h("div", { class: "tools", role: "toolbar", "aria-label": "Time" },
    h("span", { class: "joint" }, spans.map(([, button]) => button), h("button", { onclick: () => window.all() }, "All")), live, shown,
    h("span", { class: "end" },
      h("span", { class: "joint" },
        h("button", { "aria-keyshortcuts": "[", onclick: () => step("desc") }, "‹ Episode"),
        h("button", { "aria-keyshortcuts": "]", onclick: () => step("asc") }, "Episode ›")),
      h("span", { class: "joint" },
        h("button", { "aria-label": "Zoom out", onclick: () => window.zoom(2) }, "−"),
        h("button", { "aria-label": "Zoom in", onclick: () => window.zoom(0.5) }, "+")),
      h("button", { "aria-label": "Keys", popovertarget: "keys" }, "?"), keys));
  rove(node, "button", TO_AND_FRO)();

  function show({ since, until, live: follows }, { clock, live: attached }) {
    for (const [span, button] of spans) button.setAttribute("aria-pressed", String(Math.abs(until - since - span) < 1e6));
    live.setAttribute("aria-pressed", String(follows));
    live.textContent = !attached ? "Newest" : follows ? "Live" : "Go live";
    shown.textContent = stretch(window.time(since), window.time(until), clock);
  }

  return { node, show };
}
