// The list of all sessions with their states.

import { items } from "./api.js";
import { h, Place, table } from "./dom.js";
import { at, badge, byGravity, count, life, moment } from "./words.js";

const HEAD = ["session", "spec", "status", "worst outcome", "violations", "steps", "monitors", "opened"];

/** The list of sessions. */
export function sessionsView() {
  const list = new Place("section");
  return {
    node: h("div", {}, h("h1", {}, "Sessions"), list.node),
    refresh: async () => list.show((await items("sessions")).map(summary), listed),
  };
}

/** The part of a session's state that the list shows. */
function summary(state) {
  const { id, spec, kind, status, live, idle, without_monitor_since: since, clock, opened, trouble, properties, counters, monitors, continued_by: next } = state;
  const connected = monitors.filter((each) => each.connected).length;
  const outcomes = properties.map((each) => each.outcome).sort(byGravity);
  const violations = properties.reduce((sum, each) => sum + each.violations, 0);
  const seen = { connected, of: monitors.length };
  return { id, spec, kind, status, live, idle, since, clock, opened, trouble, next, outcomes, violations, steps: counters.steps, ...seen };
}

function listed(sessions) {
  if (!sessions.length) return h("p", { class: "hint" }, "None yet: attach an adapter, or a monitor of ROSMonitoring.");
  return table("sessions", HEAD, sessions.map((each) => [
    h("a", { href: at(each.id) }, each.id),
    h("a", { href: `#/specs/${encodeURIComponent(each.spec)}` }, each.spec),
    [
      life(each),
      each.trouble ? h("p", { class: "complaint" }, each.trouble) : null,
    ],
    badge(each.outcomes[0] ?? "unknown"),
    each.outcomes.length ? count(each.violations) : "–",
    String(each.steps ?? "–"),
    each.status === "open" ? `${each.connected} of ${each.of}` : "–",
    moment(each.opened),
  ]));
}
