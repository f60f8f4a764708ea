// The list of all sessions with their states.

import { items } from "./api.js";
import { h, Place, table } from "./dom.js";
import { at, badge, count, life, moment } from "./words.js";

const HEAD = ["session", "spec", "status", "worst outcome", "violations", "steps", "monitors", "opened"];

/** The list of sessions. */
export function sessionsView() {
  const list = new Place("section");
  return {
    node: h("div", {}, h("h1", {}, "Sessions"), list.node),
    refresh: async () => list.show(await items("sessions", { brief: true }), listed),
  };
}

function listed(sessions) {
  if (!sessions.length) return h("p", { class: "hint" }, "None yet: attach an adapter, or a monitor of ROSMonitoring.");
  return table("sessions", HEAD, sessions.map((each) => [
    h("a", { href: at(each.id) }, each.id),
    h("a", { href: `#/specs/${encodeURIComponent(each.spec)}` }, each.spec),
    [
      life({ ...each, since: each.without_monitor_since }),
      each.trouble ? h("p", { class: "complaint" }, each.trouble) : null,
    ],
    badge(each.outcome ?? "unknown"),
    each.outcome ? count(each.violations) : "–",
    String(each.steps ?? "–"),
    each.status === "open" ? `${each.connected} of ${each.monitors}` : "–",
    moment(each.opened),
  ]));
}
