// The view of one session: its properties, steps, violations, streams and monitors, and the explanation of a verdict.

import { get, items, of } from "./api.js";
import { chartView } from "./chart.js";
import { h, Place, table } from "./dom.js";
import { timelineView } from "./timeline.js";
import { verdictView } from "./verdict.js";
import { violationsView } from "./violations.js";
import { at, badge, byGravity, count, life, moment, place, span, stream } from "./words.js";

/** The view of a session, and of its verdict number `n` if given; `again` refreshes the page at once. */
export function sessionView(id, n, again) {
  const head = new Place("section");
  const properties = new Place("section");
  const streams = new Place("section");
  const chart = chartView(id, n);
  const timeline = timelineView(id, choose);
  const verdict = verdictView(id, n, explained, again);
  const violations = violationsView(id, again);
  let spec = null;
  const node = h("div", {}, h("h1", {}, id), head.node,
    h("div", { class: "beside" }, timeline.node, verdict.node,
      h("div", { class: "details" },
        h("h2", {}, "Properties"), properties.node,
        h("h2", {}, "Steps"), chart.node,
        h("h2", {}, "Violations"), violations.node,
        h("h2", {}, "Streams and monitors"), streams.node)));

  async function refresh() {
    const state = await get(of(id));
    spec ??= await specOf(state);
    head.show(headline(state), headed);
    properties.show({ id, spec: spec.formulas, states: state.properties, clock: state.clock }, propertyTable);
    streams.show({ streams: state.streams, monitors: state.monitors, clock: state.clock }, streamTables);
    const parts = await Promise.allSettled([timeline.refresh(state, spec.thresholds), verdict.refresh(state), violations.refresh(state)]);
    await chart.refresh(state);
    for (const { reason } of parts) if (reason) throw reason;
  }

  function explained(steps, record) {
    chart.witness(steps);
    if (!record) timeline.pin(null);
    else if (record.stamp !== undefined) timeline.pin(record.stamp);
  }

  /** Choose a verdict of a property, or the gravest of all: a violation from `since` to `until` (ns), else the last one. */
  async function choose(property, since, until) {
    const of_it = property ? { property } : {};
    const [violation] = await items(of(id, "violations"), { ...of_it, since, until, limit: 1 });
    const limit = property ? 1 : Math.max(1, Object.keys(spec?.formulas ?? {}).length);
    const others = violation ? [] : await items(of(id, "verdicts"), { ...of_it, until, order: "desc", limit });
    const [found] = [violation, ...others].filter(Boolean).sort((one, other) => byGravity(one.outcome, other.outcome));
    if (!found) return;
    timeline.pin(found.stamp);
    location.hash = at(id, found.n).slice(1);
  }

  return {
    key: id,
    n,
    node,
    refresh,
    goTo: (other) => {
      chart.goTo(other);
      verdict.goTo(other);
    },
    leave: () => {
      verdict.leave();
      timeline.leave();
    },
  };
}

/** The session's spec: its properties by id, and what numbers they compare with; none where the server has another one. */
async function specOf(state) {
  const found = await get(`specs/${encodeURIComponent(state.spec)}`).catch(() => null);
  if (found?.digest !== state.spec_digest) return { formulas: {}, thresholds: [] };
  return { formulas: Object.fromEntries(found.properties.map((each) => [each.id, each])), thresholds: found.thresholds ?? [] };
}

function headline({ spec, kind, status, live, idle, without_monitor_since: since, closed_because: because, clock, opened, closed, trouble, waiting, counters, disagree, continued_by: next }) {
  return { spec, kind, status, live, idle, since, because, clock, opened, closed, trouble, waiting, counters, disagree, next };
}

function headed(state) {
  const counted = Object.entries(state.counters).filter(([name, value]) => value || (name === "steps" && value !== null));
  return [
    h("p", {},
      h("strong", { class: state.status }, life(state)), `, ${state.status} since ${moment(state.closed ?? state.opened)}`,
      state.because ? ` (${state.because})` : "", ", judged by ",
      h("a", { href: `#/specs/${encodeURIComponent(state.spec)}` }, state.spec),
      state.next ? [", continued as ", h("a", { href: at(state.next) }, state.next)] : null),
    h("p", { class: "counters" }, counted.map(([name, value]) => h("span", {}, `${value} ${name}`))),
    state.trouble ? h("p", { class: "complaint" }, state.trouble) : null,
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
    ],
    [badge(each.outcome), each.robustness === null ? null : ` robustness ${each.robustness}`, each.pending ? ` ${each.pending} open` : null],
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
