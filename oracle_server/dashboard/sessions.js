// The list of all sessions with their states: those that need somebody first.

import { items } from "./api.js";
import { h, Place, table } from "./dom.js";
import { at, badge, byGravity, count, life, moment } from "./words.js";

const HEAD = ["session", "spec", "status", "worst outcome", "violations", "steps", "monitors", "opened"];
const MOST = 200; // rows that are shown unless more are asked for
const FAILING = ["false", "currently_false"];
const KINDS = {
  All: () => true,
  Failing: ({ outcome }) => FAILING.includes(outcome),
  Open: ({ status }) => status === "open",
  Closed: ({ status }) => status !== "open",
};

/** The list of sessions, with a search by text and by kind. */
export function sessionsView() {
  const list = new Place("section", { class: "found" });
  let [all, order, kind, most] = [[], [], "All", MOST];
  const field = h("input", { type: "search", placeholder: "Session or spec", "aria-label": "Search sessions", oninput: show });
  const kinds = Object.keys(KINDS).map((name) => h("button", { onclick: () => choose(name) }, name));
  const node = h("div", {}, h("h1", {}, "Sessions"), h("p", { class: "tools" }, field, kinds), list.node);

  async function refresh() {
    all = await items("sessions", { brief: true });
    show();
  }

  function choose(name) {
    [kind, most] = [name, MOST];
    show();
  }

  function show() {
    const text = field.value.trim().toLowerCase();
    const found = all.filter((each) => KINDS[kind](each) && `${each.id} ${each.spec}`.toLowerCase().includes(text));
    kinds.forEach((button) => button.setAttribute("aria-pressed", String(button.textContent === kind)));
    order = sorted(found, list.node.matches(":hover") ? order : []);
    list.show([order.slice(0, most), order.length, all.length], ([rows, of, any]) => listed(rows, of, any, more));
  }

  function more() {
    most *= 5;
    show();
  }

  return { node, refresh };
}

/** Sessions, those that fail first, then open ones; those that are shown keep their places while somebody points there. */
function sorted(sessions, before) {
  const places = new Map(before.map(({ id }, i) => [id, i]));
  const place = ({ id }) => places.get(id) ?? places.size;
  const closed = ({ status }) => Number(status !== "open");
  return [...sessions].sort((one, other) => place(one) - place(other) || closed(one) - closed(other)
    || byGravity(one.outcome ?? "true", other.outcome ?? "true"));
}

function listed(sessions, found, any, more) {
  if (!any) return h("p", { class: "hint" }, "None yet: attach an adapter, or a monitor of ROSMonitoring.");
  if (!found) return h("p", { class: "hint" }, `None of ${any} is like that.`);
  return [
    table("sessions", HEAD, sessions.map((each) => [
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
    ])),
    found > sessions.length ? h("p", {}, h("button", { onclick: more }, `Show more of ${found}`)) : null,
  ];
}
