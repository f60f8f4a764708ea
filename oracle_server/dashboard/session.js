// The view of one session: its properties, steps, violations, streams and monitors, and the explanation of a verdict.

import { at, compared, ofRobot, rename } from "./address.js";
import { get, items, of } from "./api.js";
import { barView } from "./bar.js";
import { chartView } from "./chart.js";
import { now as present } from "./clock.js";
import { h, Place, rove, table, UP_AND_DOWN, wide } from "./dom.js";
import { episodeList, episodesOf } from "./episodes.js";
import { nowView } from "./now.js";
import { linkButton } from "./link.js";
import { recordedNotes } from "./recorded.js";
import { timelineView } from "./timeline.js";
import { verdictView } from "./verdict.js";
import { violationsView } from "./violations.js";
import { badge, byGravity, count, counted, life, moment, ordered, place, span, stream } from "./words.js";

const TROUBLES = 3; // streams of which it is said at the head what is wrong with them
const UNKNOWN = { formulas: Object.create(null), thresholds: [] }; // of a spec
const LONG = 120_000; // ms without a step, from which on it is said
const SETTLED = 400; // ms after the last move until the address says what is in view
const PARTS = { Now: ".now", Time: ".time", Why: ".verdict", Sequence: ".sequence", More: ".details" };

/**
 * The view of the session that an `address` names, of its time and its verdict; `again` refreshes the page at once, `anew` opens
 * another view in place of this one, where another session has the name.
 */
export function sessionView(address, again, anew) {
  const { id } = address;
  let n = address.n;
  let [spec, timer, at_, opened] = [null, null, null, null];
  const head = new Place("div", { class: "head" });
  const properties = new Place("section", wide("properties"));
  const settle = rove(properties.node, "a", UP_AND_DOWN);
  const streams = new Place("section", wide("streams and monitors"));
  const episodes = episodesOf(id);
  const now = nowView(id, visit);
  const list = episodeList(id, visit);
  const chart = chartView(id, n);
  const timeline = timelineView(id, { choose, step, moved });
  const verdict = verdictView(id, n, explained, again);
  const violations = violationsView(id, again);
  const steps = whileInView(chart.node);
  const link = linkButton(() => at(id, n, timeline.seen()));
  const node = h("div", { class: "session opening", onkeydown: pressed },
    h("div", { class: "title" }, h("h1", {}, id), head.node, link), now.node,
    h("div", { class: "beside" }, timeline.node, verdict.node,
      h("div", { class: "details" },
        h("h2", {}, "Episodes"), list.node,
        h("h2", {}, "Properties"), properties.node,
        h("h2", {}, "Steps"), chart.node,
        h("h2", {}, "Violations"), violations.node,
        h("h2", {}, "Streams and monitors"), streams.node)));
  const bar = barView(node, PARTS, () => n || timeline.explain());
  node.append(bar.node);
  if (address.from !== null) timeline.open(address);

  async function refresh() {
    const [state, found] = await standing();
    opened ??= state.opened;
    if (state.opened !== opened) { // the server has lost its history, or deleted the session: nothing that was read is of this one
      rename(at(id));
      return anew();
    }
    spec ??= await specOf(state);
    const { formulas, thresholds } = spec ?? UNKNOWN;
    const tell = () => head.show({ ...headline(state, found, episodes.first()), changed: spec?.changed, silent: silence(state, timeline.last()) }, (each) => headed(each, visit));
    tell();
    properties.show({ id, spec: formulas, states: state.properties, clock: state.clock }, propertyTable);
    settle();
    streams.show({ streams: state.streams, monitors: state.monitors, clock: state.clock }, streamTables);
    const drawn = timeline.refresh(state, thresholds, found);
    const past = () => !state.live || state.kind === "recording" || silence(state, timeline.last()) !== null; // whether the newest step is not of now
    const parts = await Promise.allSettled([
      drawn, drawn.catch(() => {}).then(tell).then(() => now.refresh(state, found, timeline.last(), past())).finally(shown), // these say what they can without
      verdict.refresh(state), violations.refresh(state),
    ]);
    list.show(found, state, timeline.last());
    await steps(() => chart.refresh(state));
    bar.show();
    for (const { reason } of parts) if (reason) throw reason;
  }

  /** Show what is below the head: what comes above it later would move a button away while it is pressed. */
  function shown() {
    node.classList.remove("opening");
  }

  async function standing() {
    const state = await get(of(id));
    return [state, await episodes.refresh(state)];
  }

  function explained(steps, record) {
    chart.witness(steps);
    if (!record?.computing || record.property) timeline.blame((record?.waited ?? []).map((each) => stream(each.stream, each.kind)));
    if (!record) timeline.pin(null);
    else if (record.stamp !== undefined) timeline.pin(ordered(record));
  }

  /** Choose a verdict of a property, or the gravest of all: a violation from `since` to `until` (ns), else the last one. */
  async function choose(property, since, until) {
    const of_it = property ? { property } : {};
    const [violation] = await items(of(id, "violations"), { ...of_it, since, until, limit: 1 });
    const limit = property ? 1 : Math.max(1, Object.keys(spec?.formulas ?? {}).length);
    const others = violation ? [] : await items(of(id, "verdicts"), { ...of_it, until, order: "desc", limit });
    const [found] = [violation, ...others].filter(Boolean).sort((one, other) => byGravity(one.outcome, other.outcome));
    if (!found) return;
    timeline.pin(ordered(found));
    show(found.n);
  }

  /** Show another verdict, or none, at what is in view. */
  function show(number) {
    location.hash = at(id, number, timeline.part() ?? {}).slice(1);
  }

  /** Go to an episode: to its time, and to why it began. */
  function visit(episode, click) {
    if (click?.ctrlKey || click?.metaKey || click?.shiftKey) return; // opened beside this page
    click?.preventDefault();
    at_ = episode;
    timeline.visit(episode);
    timeline.pin(episode.began);
    show(episode.first);
  }

  /** Go to the episode that is next (`asc`), or before (`desc`). */
  function step(order) {
    const from = at_ && at_.first === n ? at_ : timeline.middle();
    episodes.next(from, order).then((found) => found && visit(found)).catch(() => {}); // the next refresh tells what is wrong
  }

  /** Something else is in view: name it in the address, once it stays. */
  function moved() {
    clearTimeout(timer);
    timer = setTimeout(() => rename(at(id, n, timeline.part() ?? {})), SETTLED);
  }

  function pressed(event) {
    const act = { "[": () => step("desc"), "]": () => step("asc"), Escape: () => n && show(null) }[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, textarea, select")) return;
    event.preventDefault();
    act();
  }

  function goTo(other) {
    n = other.n;
    if (other.from !== null) timeline.open(other);
    else if (!n) timeline.follow();
    chart.goTo(n);
    verdict.goTo(n);
    moved();
  }

  function leave() {
    clearTimeout(timer);
    for (const part of [verdict, timeline, bar, steps]) part.leave();
  }

  return { key: id, node, refresh, goTo, leave };
}

/** Calls what it is given until that has answered once, and then only while an element can be seen; paper says where it was not. */
function whileInView(node) {
  let [seen, filled] = [false, false];
  const observer = new IntersectionObserver(([entry]) => (seen = entry.isIntersecting), { rootMargin: "200px" });
  observer.observe(node);
  const call = async (act) => {
    node.toggleAttribute("data-old", filled && !seen);
    if (filled && !seen) return;
    await act();
    filled = true;
  };
  return Object.assign(call, { leave: () => observer.disconnect() });
}

/** The session's spec: its properties by id, and what numbers they compare with; none where the server has another one, null where it does not tell now. */
async function specOf(state) {
  const found = await get(`specs/${encodeURIComponent(state.spec)}`).catch(({ status = 0 }) => (status === 0 || status >= 429 ? null : {}));
  if (found === null) return null;
  if (found.digest !== state.spec_digest) return { ...UNKNOWN, changed: Boolean(found.digest) };
  return { formulas: Object.fromEntries(found.properties.map((each) => [each.id, each])), thresholds: found.thresholds ?? [] };
}

function headline({ id, spec, kind, origin, run, status, live, idle, without_monitor_since: since, closed_because: because, clock, opened, closed, trouble, waiting, counters, disagree, continued_by: next, monitors, recording }, found, first) {
  const open = found.filter((each) => each.open).length;
  const there = monitors.filter((each) => each.connected).length;
  const told = monitors.filter(({ attached }) => attached && status === "open").flatMap(({ streams }) => streams ?? []);
  const troubles = told.filter((each) => each.trouble).map((each) => `${each.stream}: ${each.trouble}`);
  return { id, spec, kind, origin, run, status, live, idle, since, because, clock, opened, closed, trouble, waiting, counters, disagree, next, open, first, there, monitors: monitors.length, troubles, recording };
}

/** For how long an open session has had no step, in words, by its newest one (ns); null where that is not long. */
function silence({ status, clock, kind }, last) {
  const long = last === null ? 0 : present() - Number(last) / 1e6;
  return status === "open" && clock === "wall" && kind !== "recording" && long > LONG ? span(long * 1e6) : null;
}

function headed(state, visit) {
  const counted_ = Object.entries(state.counters).filter(([name, value]) => value || (name === "steps" && value !== null));
  return [
    h("p", { class: "facts" },
      state.run > 1 ? h("span", { class: "tag" }, `run ${state.run}`) : null,
      state.origin ? h("span", {}, "forwarded from ", h("a", { href: ofRobot(state.origin) }, state.origin)) : null,
      state.open ? h("span", { class: "chip bad" }, `✗ ${counted(state.open, "open episode")}`) : null,
      h("span", {}, h("strong", { class: state.status }, life(state)), `, ${state.status} since ${moment(state.closed ?? state.opened)}`,
        state.because ? ` (${state.because})` : ""),
      state.first ? h("span", {}, "first wrong ", h("a", { href: at(state.id, state.first.first), onclick: (click) => visit(state.first, click) }, moment(state.first.began, state.clock)), ` (${state.first.property})`) : null,
      state.status === "open" ? h("span", {}, h("b", {}, `${state.there} of ${state.monitors}`), " monitors") : null,
      state.silent ? h("span", { class: "waiting" }, `newest step ${state.silent} ago`) : null,
      h("span", {}, "judged by ", h("a", { href: `#/specs/${encodeURIComponent(state.spec)}` }, state.spec),
        state.changed ? ", which has another text now" : null, state.next ? [", continued as ", h("a", { href: at(state.next) }, state.next)] : null),
      counted_.map(([name, value]) => h("span", {}, h("b", {}, String(value)), ` ${name}`)),
      h("a", { href: compared(state.id) }, "Compare…")),
    state.trouble ? h("p", { class: "complaint" }, state.trouble) : null,
    state.troubles.slice(0, TROUBLES).map((text) => h("p", { class: "complaint" }, text)),
    state.troubles.length > TROUBLES ? h("p", { class: "complaint" }, `and ${state.troubles.length - TROUBLES} more streams, below`) : null,
    recordedNotes(state),
    state.waiting ? h("p", { class: "waiting" }, state.waiting) : null,
    state.disagree?.length ? h("p", { class: "complaint" }, `The orders disagree on ${state.disagree.join(", ")}.`) : null,
  ];
}

function propertyTable({ id, spec, states, clock }) {
  const both = new Set(states.map((each) => each.order)).size > 1;
  const first = (each) => each.first_violation &&
    h("a", { href: at(id, each.first_violation) }, firstAt(each, clock));
  return table("properties", ["property", "outcome", "violations", "first at", "unknown"], states.map((each) => [
    [
      h("strong", {}, each.id), both ? ` by ${each.order}` : null,
      spec[each.id] ? [h("p", { class: "hint" }, spec[each.id].description), h("code", {}, spec[each.id].formula)] : null,
      [each.broken, each.complaint, ...(each.caveats ?? []).map((text) => `degraded: ${text}`)].map((text) => (text ? h("p", { class: "complaint" }, text) : null)),
      each.unasked ? h("p", { class: "hint unasked" }, "nothing was asked of it: ", h("code", {}, each.unasked), " never held") : null,
    ],
    [badge(each.outcome), each.degraded ? " degraded" : null, each.robustness === null ? null : ` robustness ${each.robustness}`, each.pending ? ` ${each.pending} open` : null],
    count(each.violations),
    first(each) || "–",
    count(each.unknown),
  ]));
}

/** Where the first violation was; sessions of older versions have its number only. */
function firstAt({ first_violation: n, first_violation_step: number, first_violation_at: stamp }, clock) {
  return stamp === undefined || stamp === null ? `#${n}` : place(number, stamp, clock);
}

function streamTables({ streams, monitors, clock }) {
  return [
    !streams.length ? null : table("streams", ["stream", "monitor", "frontier", "lag", "held", "late", "lost", "duplicates"],
      streams.map((each) => [
        stream(each.stream, each.kind), each.monitor, moment(each.frontier, clock), span(each.lag),
        count(each.depth), count(each.late), count(each.lost), count(each.duplicates),
      ])),
    table("monitors", ["monitor", "state", "events so far", "troubles that it reports"], monitors.map((each) => [
      each.name,
      each.connected ? "connected" : each.attached ? "disconnected" : "detached",
      String(each.next - 1),
      each.streams.filter((one) => one.trouble).map((one) => h("p", { class: "complaint" }, `${one.stream}: ${one.trouble}`)),
    ])),
  ];
}
