// The session by time: properties, streams, signals and decisions on one axis that is dragged, zoomed, and followed live.

import { get, of } from "./api.js";
import { h, Place } from "./dom.js";
import { jumpBy, moveBy } from "./gestures.js";
import { rowsOf, worstOf } from "./lanes.js";
import { paintAxis, paintOverview } from "./painting.js";
import { moment } from "./words.js";
import { Window } from "./window.js";

const SPANS = [["10 s", 10e9], ["60 s", 60e9], ["10 min", 600e9]];
const MARGIN = 0.25; // of a window that stands still is asked for on both sides, so that something is there when it moves
const COARSE = 2; // pixels a bucket where it is live: it is asked for each second
const MOST = 2000; // buckets in one answer
const OVERVIEW = 300;
const PLOTS = 4; // signals
const SOON = 60; // ms from a move to the request

/** The timeline of a session; `choose(property, since, until)` is called with the lane, if one was clicked, and the time of the pixel (ns). */
export function timelineView(id, choose) {
  const window = new Window(moved);
  const bar = toolbar(window);
  const [overview, axis] = ["overview", "axis"].map((name) => h("canvas", { class: name, "aria-hidden": "true" }));
  const cursor = h("div", { class: "cursor", hidden: true });
  const body = new Place("div", { class: "rows" });
  const plots = h("div", {
    class: "plots", tabindex: 0, role: "group",
    "aria-label": "Timeline. Arrow keys move it, plus and minus zoom, 0 shows all, l follows the newest steps.",
  }, lane("Whole session", overview), lane("", axis), body.node, cursor);
  moveBy(plots, axis, window, clicked);
  jumpBy(overview, window);
  const resized = new ResizeObserver(moved);
  resized.observe(plots);
  const node = h("section", { class: "time", "aria-label": "Time" }, bar.node, plots);
  let [state, thresholds, rows, whole, known, timer, frame] = [null, [], [], null, null, null, null];
  let [pinned, sought] = [null, false];

  /** Show the session as it is now; `compared` are the numbers that its formulas compare signals with. */
  async function refresh(next, compared) {
    [state, thresholds] = [next, compared];
    const found = await get(of(id, "timeline"), { buckets: OVERVIEW, part: "lanes" });
    if (found.first === null) return;
    window.reach(found.first, found.last);
    seek();
    whole = worstOf(found, window);
    const news = [window.since, window.until, Math.min(window.end, window.until), state.revising?.passes].join();
    if (news === known) return draw();
    await ask();
    known = news;
  }

  /** Ask for what is in view, and for some of what is beside it. */
  async function ask() {
    const pixels = axis.clientWidth;
    if (!pixels || window.origin === null) return;
    const margin = window.live ? 0 : MARGIN * (window.until - window.since);
    const [since, until] = [Math.max(0, window.since - margin), Math.min(window.end, window.until + margin)];
    if (until < since) return;
    const share = (until - since) / (window.until - window.since);
    const buckets = Math.max(1, Math.min(MOST, Math.round((pixels * share) / (window.live ? COARSE : 1))));
    const signal = [...new Set(thresholds.map((each) => each.signal))].slice(0, PLOTS);
    build(await get(of(id, "timeline"), { since: window.time(since), until: window.time(until), buckets, signal }));
  }

  function build(answer) {
    rows = rowsOf(answer, state, thresholds, window);
    body.show(rows.map(({ group, name, title }) => [group, name, title]), () => rows.map(row));
    rows.forEach((each, i) => {
      const [, canvas, value] = body.node.children[i].children;
      each.canvas = canvas;
      if (value.textContent !== each.value) value.textContent = value.title = each.value;
      value.className = `value ${each.mood ?? ""}`;
    });
    draw();
  }

  /** The window has moved: draw what is known at once, and ask for the rest. */
  function moved() {
    draw();
    clearTimeout(timer);
    if (state) timer = setTimeout(() => ask().catch(() => {}), SOON); // the next refresh tells what is wrong
  }

  function draw() {
    frame ??= requestAnimationFrame(() => {
      frame = null;
      if (window.origin === null) return;
      bar.show(window, state.clock);
      if (whole) paintOverview(overview, window, whole);
      paintAxis(axis, window, state.clock);
      for (const { canvas, paint } of rows) if (canvas) paint(canvas, window);
      placeCursor();
    });
  }

  function clicked(share, target) {
    const pixel = (window.until - window.since) / axis.clientWidth;
    const at = window.since + share * (window.until - window.since);
    const each = rows.find(({ canvas }) => canvas === target);
    window.show(window.since, window.until);
    choose(each?.group === "property" ? each.name : null, window.time(at - pixel), window.time(at + pixel)).catch(() => {}); // as above
  }

  /** Mark a time (ns), or none; the window is moved there where the time is not in view. */
  function pin(time) {
    if (pinned === time) return;
    [pinned, sought] = [time, time !== null];
    seek();
    draw();
  }

  function seek() {
    if (!sought || window.origin === null) return;
    sought = false;
    const [at, half] = [window.offset(pinned), (window.until - window.since) / 2];
    if (at < window.since || at > window.until) window.show(at - half, at + half);
  }

  function placeCursor() {
    const at = pinned === null ? -1 : (window.offset(pinned) - window.since) / (window.until - window.since);
    cursor.hidden = at < 0 || at > 1;
    if (!cursor.hidden) cursor.style.left = `${axis.offsetLeft + at * axis.clientWidth}px`;
  }

  function leave() {
    clearTimeout(timer);
    cancelAnimationFrame(frame);
    resized.disconnect();
  }

  return { node, refresh, pin, leave };
}

function row({ group, name, title, tall }) {
  const canvas = h("canvas", { "aria-hidden": "true", class: tall ? "tall" : "" });
  return lane(h("span", { title }, name), canvas, group);
}

function lane(label, canvas, group = "") {
  return h("div", { class: `lane ${group}` }, h("div", { class: "label" }, label), canvas, h("div", { class: "value" }));
}

/** Buttons that move the window, and what it shows in words. */
function toolbar(window) {
  const spans = SPANS.map(([text, span]) => [span, h("button", { onclick: () => window.take(span) }, text)]);
  const live = h("button", { onclick: () => window.follow() }, "Live");
  const shown = h("span", { class: "hint" });
  const node = h("div", { class: "tools" }, spans.map(([, button]) => button),
    h("button", { onclick: () => window.all() }, "All"), live, shown,
    h("span", { class: "end" },
      h("button", { "aria-label": "Zoom out", onclick: () => window.zoom(2) }, "−"),
      h("button", { "aria-label": "Zoom in", onclick: () => window.zoom(0.5) }, "+")));

  function show({ since, until, live: follows }, clock) {
    for (const [span, button] of spans) button.setAttribute("aria-pressed", String(Math.abs(until - since - span) < 1e6));
    live.setAttribute("aria-pressed", String(follows));
    live.textContent = follows ? "Live" : "Go live";
    shown.textContent = `${moment(window.time(since), clock)} to ${moment(window.time(until), clock)}`;
  }

  return { node, show };
}
