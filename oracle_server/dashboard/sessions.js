// The fleet: all sessions, what is wrong in each now, and those that need somebody first.

import { at, ofRobot, rename } from "./address.js";
import { getKept, items } from "./api.js";
import { now } from "./clock.js";
import { h, Place, rove, TO_AND_FRO, UP_AND_DOWN } from "./dom.js";
import { dropView } from "./drop.js";
import { lasted, reasonOf, worstOf } from "./episodes.js";
import { dayView, HOUR, time } from "./day.js";
import { grouped, KINDS, matches } from "./fleet.js";
import { strip } from "./strip.js";
import { badge, count, counted, life, moment, span } from "./words.js";

const HEAD = ["session", "what is wrong", "for", "last hour", "in 24 h", "outcome", "spec", "status", "steps", "monitors", "opened"];
const MOST = 200; // rows that are shown unless more are asked for
const WIDE = 12; // thousandths of an hour's strip: two pixels
const LISTED = 1000; // closed sessions that the server lists
const EPISODES = 1000; // open ones that are asked for

/** The list of sessions, with a search by text and by kind, which the address names. */
export function sessionsView({ q = "", show: shown = "" } = {}, again = () => {}) {
  const list = new Place("section", { class: "found" });
  const day = dayView(() => show());
  const drop = dropView(again);
  const field = h("input", { type: "search", placeholder: "Session, spec:…, property:… or origin:…", "aria-label": "Search sessions", "aria-keyshortcuts": "/", value: q, oninput: changed });
  const kinds = Object.keys(KINDS).map((name) => h("button", { "data-kind": name, onclick: () => choose(name) }, name));
  const joint = h("span", { class: "kinds", role: "toolbar", "aria-label": "Kinds" }, kinds);
  const node = h("div", { class: "fleet" }, h("h1", {}, "Sessions"), h("p", { class: "tools" }, joint, h("span", { class: "end" }, field)), day.node, day.list, drop.node, list.node);
  const body = h("tbody");
  const frame = h("table", { class: "sessions", "aria-label": "sessions; arrow keys go from one to the next" },
    h("thead", {}, h("tr", {}, HEAD.map((title) => h("th", { scope: "col" }, title)))), body);
  const settle = rove(body, "td:first-child > a:first-child", UP_AND_DOWN);
  const rows = new Map(); // of what is shown: the text that a row was made of, and the row
  let [all, origins, ofDay, order, kind, most] = [[], new Map(), [], [], KINDS[shown] ? shown : "All", MOST];
  rove(joint, "button", TO_AND_FRO)();

  async function refresh() {
    const [sessions, open] = await Promise.all([
      items("sessions", { brief: true }, getKept), items("episodes", { open: true, limit: EPISODES }, getKept),
    ]);
    origins = new Map(sessions.map(({ id, origin }) => [id, origin]));
    const simulated = new Set(sessions.filter(({ clock }) => clock === "sim").map(({ id }) => id)); // whose times are none of the day
    const { episodes, from } = await day.refresh(open, sessions);
    ofDay = episodes.filter(({ session }) => !simulated.has(session));
    all = grouped(sessions, open, ofDay, from);
    show();
    await drop.refresh();
  }

  function choose(name) {
    [kind, most] = [name, MOST];
    changed();
  }

  function changed() {
    const query = new URLSearchParams([["q", field.value.trim()], ["show", kind === "All" ? "" : kind]].filter(([, text]) => text));
    rename(`#/${query.size ? `?${query}` : ""}`);
    show();
  }

  function show() {
    for (const button of kinds) {
      const { kind: name } = button.dataset;
      button.setAttribute("aria-pressed", String(name === kind));
      button.replaceChildren(`${name} `, h("b", {}, String(all.filter(KINDS[name]).length)));
    }
    day.show(ofDay.filter((each) => matches({ id: each.session, spec: each.spec, origin: origins.get(each.session), open: [each] }, field.value)));
    const found = all.filter((each) => KINDS[kind](each) && matches(each, field.value));
    const places = new Map((list.node.matches(":hover, :focus-within") ? order : []).map((id, i) => [id, i]));
    const place = ({ id }) => places.get(id) ?? places.size;
    const sorted = found.sort((one, other) => place(one) - place(other)); // who points there finds it where it was
    order = sorted.map(({ id }) => id);
    const cut = all.filter(({ status }) => status === "closed").length >= LISTED;
    list.show([found.length > 0, all.length > 0, found.length > most && found.length, cut], ([any, some, rest]) => [
      any ? frame : h("p", { class: "hint" }, some ? `None of ${all.length} is like that.` : "None yet: attach an adapter, or a monitor of ROSMonitoring."),
      rest ? h("p", {}, h("button", { onclick: more }, `Show more of ${rest}`)) : null,
      cut ? h("p", { class: "hint" }, `Of closed sessions the last ${LISTED} are here; there may be older ones.`) : null,
    ]);
    fill(sorted.slice(0, most));
  }

  function more() {
    most *= 5;
    show();
  }

  /** Bring the table up to date: only rows that have changed are made anew. */
  function fill(sessions) {
    const focused = body.contains(document.activeElement) ? document.activeElement.getAttribute("href") : null;
    const wanted = [];
    let title = null;
    const minute = Math.floor(now() / 60_000); // in which the last hour moves by a pixel or two
    for (const each of sessions) {
      if (each.group !== title) wanted.push(kept(`group ${(title = each.group)}`, each.group, () => heading(each.group)));
      const long = duration(each);
      wanted.push(kept(`session ${each.id}`, [each, long, minute], () => row(each, long)));
    }
    for (const key of [...rows.keys()]) if (!wanted.includes(rows.get(key).node)) rows.delete(key);
    wanted.forEach((each, i) => body.children[i] === each || body.insertBefore(each, body.children[i] ?? null));
    while (body.children.length > wanted.length) body.lastChild.remove();
    settle();
    if (focused && !body.contains(document.activeElement)) body.querySelector(`[href="${CSS.escape(focused)}"]`)?.focus();
  }

  function kept(key, value, build) {
    const text = JSON.stringify(value, (_, each) => (typeof each === "bigint" ? `${each}n` : each));
    if (rows.get(key)?.text !== text) rows.set(key, { text, node: build() });
    return rows.get(key).node;
  }

  return { node, refresh, leave: drop.leave };
}

function heading(group) {
  return h("tr", { class: "group" }, h("th", { colspan: HEAD.length, scope: "rowgroup" }, group));
}

/** For how long a session has been failing; where its time is not this browser's, since when; else how long ago it last did. */
function duration({ group, open: [worst], live, clock, latest }) {
  if (!worst) return latest && group !== "Wrong now" ? `${span((now() - time(latest.until)) * 1e6)} ago` : "";
  const until = live && clock === "wall" ? BigInt(now()) * 1_000_000n : null;
  return until ? span(lasted(worst, until)) : `since ${moment(worst.began, clock)}`;
}

/** What is wrong in a session: its gravest open episode, and how many more there are; else what keeps it from being judged, or from being judged right, or was wrong last, or how often it was wrong. */
function wrong({ id, group, open: [worst, ...more], trouble, caveats, doubts, unasked, latest, violations }) {
  const now_ = [trouble, ...caveats].filter(Boolean);
  const all = [...now_, ...doubts];
  const doubt = all.length ? h("span", { class: "complaint", title: all.join("\n") }, all[0]) : null;
  const idle = unasked && !all.length ? h("span", { class: "hint" }, unasked) : null;
  const before = violations ? h("span", { class: "hint" }, `${counted(violations, "violation")} before`) : null;
  if (!worst && group === "Wrong now") return [h("a", { tabindex: -1, class: "bad", href: at(id) }, "fails"), doubt]; // its episode is not among those that were asked for
  if (!worst && latest && !now_.length) return [h("a", { tabindex: -1, class: "was", href: at(id, latest.first) }, `${latest.property} for ${span(lasted(latest, null))}`), h("span", { class: "hint" }, worstOf(latest) || reasonOf(latest)), doubt];
  if (!worst) return [doubt, idle, before];
  return [
    h("a", { tabindex: -1, class: "bad", href: at(id, worst.first) }, worst.property, worst.final ? ", for good" : ""),
    more.length ? h("span", { class: "chip bad" }, `+${more.length}`) : null,
    h("span", { class: "hint", title: worst.explanation }, worstOf(worst) || reasonOf(worst)),
    doubt,
  ];
}

/** The robot that a session is forwarded from, as a link to all of its sessions. */
function from({ origin }) {
  return origin ? h("span", { class: "hint" }, " from ", h("a", { tabindex: -1, href: ofRobot(origin) }, origin)) : null;
}

/** A time without its milliseconds. */
function brief(text) {
  return text.replace(/(:\d\d)\.\d{3}/, "$1");
}

/** The last hour of a session: when it was open, and its episodes. */
function hour({ clock, opened, closed, without_monitor_since: alone, day, open, cut, violations }) {
  if (clock === "sim") return "";
  const last = now();
  const share = (ms) => Math.min(1, Math.max(0, 1 - (last - ms) / HOUR));
  const runs = [...day, ...open].map(({ began, until }) => [share(time(began)), share(until === null ? last : time(until)), "fails"]).filter(([, to]) => to > 0);
  const there = [share(time(opened)), share(closed || alone ? time(closed ?? alone) : last), "no"];
  const text = runs.length ? `${counted(day.length, "episode")}${cut ? " or more" : ""} in 24 h` : cut === "hour" ? "it is not known whether there were episodes in the last hour" : `no episode${violations ? " that is kept" : ""} in the last hour`; // of violations that are deleted nobody knows when they were
  return h("div", { title: text }, strip(there[1] > 0 ? [there, ...runs] : runs, null, WIDE));
}

function row(each, long) {
  const { id, spec, outcome, open, day, status, steps, connected, monitors } = each;
  const cells = [
    [h("a", { href: at(id) }, id), from(each)],
    wrong(each),
    long,
    hour(each),
    each.clock === "sim" ? "–" : each.cut ? `${day.length || ""}?` : count(day.length),
    badge(outcome ?? "unknown"),
    h("a", { tabindex: -1, href: `#/specs/${encodeURIComponent(spec)}` }, spec),
    brief(life({ ...each, since: each.without_monitor_since })),
    String(steps ?? "–"),
    status === "open" ? `${connected} of ${monitors}` : "–",
    brief(moment(each.opened)),
  ];
  return h("tr", { class: open.length ? "wrong" : "" }, cells.map((cell) => h("td", {}, cell)));
}
