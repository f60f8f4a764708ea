// The session by time: properties, streams, signals and decisions on one axis that is dragged, zoomed, and followed live.

import { get, of, Problem } from "./api.js";
import { h } from "./dom.js";
import { jumpBy, moveBy } from "./gestures.js";
import { rowsOf, worstOf } from "./lanes.js";
import { paintAxis, paintOverview } from "./painting.js";
import { lane, rowsView } from "./rows.js";
import { joined, sinceThen } from "./tail.js";
import { toolbar } from "./toolbar.js";
import { Window } from "./window.js";

const MARGIN = 0.25; // of a window that stands still is asked for on both sides, so that something is there when it moves
const COARSE = 2; // pixels a bucket where it is live: it is asked for each second
const MOST = 2000; // buckets in one answer
const OVERVIEW = 300;
const PLOTS = 4; // signals
const SOON = 60; // ms from a move to the request
const ANEW = 10; // times that what came since is added to an answer before all of it is asked for again

/**
 * The timeline of a session. `choose(property, since, until)` is called with the lane, if one was clicked, and the time of
 * the pixel (ns), `step(order)` for the next episode, `moved()` whenever something else is in view.
 */
export function timelineView(id, { choose, step, moved }) {
  const window = new Window(changed);
  const bar = toolbar(window, step);
  const [overview, axis] = ["overview", "axis"].map((name) => h("canvas", { class: name, "aria-hidden": "true" }));
  const cursor = h("div", { class: "cursor", hidden: true });
  const rows = rowsView(explain, () => build());
  const plots = h("div", {
    class: "plots", tabindex: 0, role: "group",
    "aria-label": "Timeline. Left and right arrows move it, up and down go from row to row, plus and minus zoom, 0 shows all, l follows the newest steps.",
  }, lane("Whole session", overview), lane("", axis), rows.node, cursor);
  moveBy(plots, axis, window, { clicked, enter: rows.enter });
  jumpBy(overview, window);
  const resized = new ResizeObserver(changed);
  resized.observe(plots);
  const node = h("section", { class: "time", "aria-label": "Time" }, bar.node, plots);
  let told = null; // how the session stands: its state, thresholds and episodes
  let [answer, asked, joins] = [null, null, 0]; // what is known of what is in view, and for what it was asked
  let [whole, last, timer, frame] = [null, null, null, null];
  let most = MOST; // buckets of which an answer may be: of many properties it would be too large
  let [pinned, sought, awaited] = [null, false, []];
  let opening = null; // the part of time that the address names, until the session is known

  /** Show the session as it is now: its `state`, the `thresholds` that formulas compare signals with, and the episodes `found`. */
  async function refresh(state, thresholds, found) {
    told = { state, thresholds, found };
    if (!whole || window.live || state.status === "open") await look();
    if (last === null) return;
    seek();
    if (asked === question()) return build();
    await ask();
  }

  /** Ask for how far the session reaches, and for all of it once that has changed by a bucket. */
  async function look() {
    const ends = whole ? await get(of(id, "timeline"), { buckets: 1, part: "steps" }) : null;
    if (ends?.first === null) return; // all of it was deleted meanwhile
    const due = !whole || window.offset(ends.last) - whole.end >= whole.width || whole.passes !== told.state.revising?.passes;
    const found = due ? await get(of(id, "timeline"), { buckets: OVERVIEW, part: "lanes" }) : ends;
    if (found.first === null) return;
    last = found.last;
    window.reach(found.first, found.last);
    if (due) whole = { ...worstOf(found, window), end: window.end, passes: told.state.revising?.passes };
  }

  /** What the answer depends on. */
  function question() {
    return [window.live, window.since, window.until, Math.min(window.end, window.until), axis.clientWidth, told.state.revising?.passes].join();
  }

  /** Ask for what is in view, and for some of what is beside it; where it is live, for what came since. */
  async function ask() {
    const pixels = axis.clientWidth;
    if (!pixels || window.origin === null) return;
    const wanted = question();
    if (!(window.live && await follow(pixels))) {
      const margin = window.live ? 0 : MARGIN * (window.until - window.since);
      const [since, until] = [Math.max(0, window.since - margin), Math.min(window.end, window.until + margin)];
      if (until < since) return;
      const share = (until - since) / (window.until - window.since);
      const buckets = Math.max(1, Math.min(MOST, Math.round((pixels * share) / (window.live ? COARSE : 1))));
      const found = await columns({ since: window.time(since), until: window.time(until), buckets, signal: signals() });
      [answer, joins] = [{ ...found, live: window.live && shape(pixels) }, 0];
    }
    asked = wanted;
    build();
  }

  /** Ask for what is in view, in fewer buckets where the answer would be too large. */
  async function columns(query) {
    for (;;) {
      const buckets = Math.min(query.buckets, most);
      try {
        return await get(of(id, "timeline"), { ...query, buckets });
      } catch (problem) {
        const smaller = problem instanceof Problem && problem.status === 422 && buckets > 1;
        most = smaller ? Math.ceil(buckets / 2) : MOST;
        if (!smaller) throw problem;
      }
    }
  }

  /** Add to the answer what came since; false where all of it is to be asked for. */
  async function follow(pixels) {
    if (!answer?.live || answer.live !== shape(pixels) || ++joins > ANEW) return false;
    const until = window.time(window.end);
    const { since, buckets } = sinceThen(answer, until);
    if (buckets > most) return false; // much time has passed since
    const later = await get(of(id, "timeline"), { since, until, buckets, signal: signals() });
    const both = joined(answer, later, window.time(Math.max(0, window.since)));
    if (both) answer = { ...both, live: answer.live };
    return Boolean(both);
  }

  /** What a live answer must have been asked for, to be gone on with. */
  function shape(pixels) {
    return [window.until - window.since, pixels, told.state.revising?.passes, ...signals()].join();
  }

  function signals() {
    return [...new Set(told.thresholds.map((each) => each.signal))].slice(0, PLOTS);
  }

  function build() {
    if (answer) rows.show(rowsOf(answer, { ...told, now: last, awaited }, window));
    draw();
  }

  /** The window has moved: draw what is known at once, and ask for the rest. */
  function changed() {
    draw();
    clearTimeout(timer);
    if (told) timer = setTimeout(() => ask().catch(() => {}), SOON); // the next refresh tells what is wrong
    moved();
  }

  function draw() {
    frame ??= requestAnimationFrame(() => {
      frame = null;
      if (window.origin === null) return;
      bar.show(window, told.state);
      if (whole) paintOverview(overview, window, whole);
      paintAxis(axis, window, told.state.clock);
      for (const { canvas, paint } of rows.shown()) if (canvas) paint(canvas, window);
      placeCursor();
    });
  }

  function clicked(share, target) {
    const pixel = (window.until - window.since) / axis.clientWidth;
    const at = window.since + share * (window.until - window.since);
    window.show(window.since, window.until);
    chosen(rows.at(target), at - pixel, at + pixel);
  }

  /** Explain a row: what there is of it in view, at last. */
  function explain(row) {
    if (last !== null) chosen(row, window.since, window.until);
  }

  function chosen(row, since, until) {
    choose(row?.group === "property" ? row.name : null, window.time(since), window.time(until)).catch(() => {}); // as above
  }

  /** Mark a time (ns), or none; the window is moved there where the time is not in view. */
  function pin(time) {
    if (pinned === time) return;
    [pinned, sought] = [time, time !== null];
    seek();
    draw();
  }

  /** Mark the streams that held up what is explained. */
  function blame(streams) {
    if (awaited.join() === streams.join()) return;
    awaited = streams;
    if (told) build();
  }

  /** Show a part of time (ns), or what is newest where it is null, once the session is known. */
  function open(part) {
    opening = part;
    seek();
  }

  function seek() {
    if (window.origin === null) return;
    if (opening) {
      window.show(window.offset(opening.from), window.offset(opening.to));
      opening = null;
    }
    if (!sought) return;
    sought = false;
    const [at, half] = [window.offset(pinned), (window.until - window.since) / 2];
    if (at < window.since || at > window.until) window.show(at - half, at + half);
  }

  function placeCursor() {
    const at = pinned === null ? -1 : (window.offset(pinned) - window.since) / (window.until - window.since);
    cursor.hidden = at < 0 || at > 1;
    if (!cursor.hidden) cursor.style.left = `${axis.offsetLeft + at * axis.clientWidth}px`;
  }

  /** What is in view (ns), null where it follows the newest steps. */
  function part() {
    return window.live || window.origin === null ? opening : { from: window.time(window.since), to: window.time(window.until) };
  }

  /** What is in view (ns), also where it follows the newest steps. */
  function seen() {
    return window.origin === null ? opening ?? {} : { from: window.time(window.since), to: window.time(window.until) };
  }

  /** A time (ns) from which the next episode is looked for: the mark, or the middle of what is in view. */
  function middle() {
    return pinned ?? window.time((window.since + window.until) / 2);
  }

  function leave() {
    clearTimeout(timer);
    cancelAnimationFrame(frame);
    resized.disconnect();
  }

  return { node, refresh, pin, blame, open, part, seen, middle, explain: () => explain(null), visit: (episode) => window.visit(episode), follow: () => window.follow(), last: () => last, leave };
}
