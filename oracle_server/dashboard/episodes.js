// A session's episodes: those that are open, the newest ones, and the one before or behind a time.

import { DelayedHistory, items, get, of } from "./api.js";
import { h, Place, rove, table, UP_AND_DOWN, wide } from "./dom.js";
import { at } from "./address.js";
import { moment, span } from "./words.js";

const NEWEST = 50;
const OPEN = 1000; // at most, so that they are counted right: a property has one
const MOST = 20; // pages that are looked through for the next one
const SIGNS = { "<=": "≤", ">=": "≥", "!=": "≠", "==": "=" };

/** The episodes of a session: `found`, open ones first, those that are final before others, then the newest. */
export function episodesOf(id) {
  const history = new DelayedHistory();
  let [found, first] = [[], null];

  /** Read them where the session's state has changed; returns them. */
  async function refresh(state) {
    const { properties, revising, status, trouble } = state;
    if (!history.isDue(JSON.stringify([status, trouble, revising?.passes, properties.map((each) => [each.violations, each.outcome])]))) return found;
    const [open, newest, oldest] = await Promise.all([
      items(of(id, "episodes"), { open: true, limit: OPEN }),
      items(of(id, "episodes"), { order: "desc", limit: NEWEST }),
      items(of(id, "episodes"), { limit: 1 }),
    ]);
    history.wasRead();
    [first = null] = oldest;
    const ended = newest.filter((each) => !each.open);
    return (found = [...open.sort((one, other) => other.final - one.final), ...ended]);
  }

  /** The episode that begins next behind (`asc`) or before (`desc`) a place: an episode, or a time (ns). */
  async function next(from, order) {
    const began = BigInt(from.began ?? from);
    const bound = order === "asc" ? { since: began } : { until: began };
    let passed = from.began === undefined; // those that began at its very time may be before or behind it
    let after;
    for (let i = 0; i < MOST; i++) {
      const page = await get(of(id, "episodes"), { ...bound, order, ...(after ? { after } : {}) });
      for (const each of page.items) {
        const apart = BigInt(each.began) - began;
        if (order === "asc" ? apart > 0n : apart < 0n) return each;
        if (passed && apart === 0n) return each;
        if (isSame(each, from)) passed = true;
      }
      if (!page.next) return null;
      after = page.next;
    }
    return null;
  }

  return { refresh, next, first: () => first };
}

/** Whether two episodes are one. */
function isSame(one, other) {
  return one.property === other?.property && one.first === other?.first && one.order === other?.order;
}

/** What is said where none is there of a session's episodes, or violations: there may have been some. */
export function noneOf({ properties, trouble }) {
  if (!properties.some((each) => each.violations > 0)) return "None.";
  return trouble ? "None that is kept." : "Those that there were are kept no more.";
}

/** How long an episode lasts (ns); an open one until `now`, the time of the newest step. */
export function lasted({ began, until }, now) {
  const end = until ?? now;
  return end === null || end === undefined ? null : Math.max(0, Number(BigInt(end) - BigInt(began)));
}

/** What was worst in an episode, in words; "" where no number tells. */
export function worstOf({ worst }) {
  if (!worst) return "";
  if (worst.robustness !== undefined) return `robustness ${brief(worst.robustness)}`;
  const { signal, op, bound, value, than } = worst;
  const holds = { "<": value < bound, "<=": value <= bound, ">": value > bound, ">=": value >= bound, "==": value === bound, "!=": value !== bound }[op];
  const limit = `${SIGNS[op] ?? op} ${than ? `${than} = ` : ""}${brief(bound)}`;
  return `${signal} = ${brief(value)}${op ? `, ${holds ? "which is" : "allowed"} ${limit}` : ""}`;
}

function brief(value) {
  return typeof value === "number" ? Number(value.toPrecision(5)) : value;
}

/** Why an episode began, without what else is said of it. */
export function reasonOf({ explanation: text }) {
  return text?.slice(text.indexOf(": ") + 1).trim() ?? "";
}

/** The list of a session's newest episodes; `visit` is called with the one that is chosen. */
export function episodeList(id, visit) {
  const list = new Place("section", wide("episodes; arrow keys go from one to the next"));
  const settle = rove(list.node, "a", UP_AND_DOWN);
  const HEAD = ["property", "began", "lasted", "violations", "worst", "why"];

  function show(found, state, now) {
    const { clock } = state;
    const none = noneOf(state);
    list.show([found, clock, none, found.some(({ open }) => open) && String(now)], () => (found.length ? listed(found, clock, now) : h("p", { class: "hint" }, none)));
    settle();
  }

  function listed(found, clock, now) {
    return [
      table("episodes", HEAD, found.map((each) => [
        h("a", { href: at(id, each.first), onclick: (click) => visit(each, click) }, each.property, each.order === "arrival" ? " by arrival" : ""),
        moment(each.began, clock),
        each.open ? h("strong", { class: "bad" }, `${span(lasted(each, now))}, ${each.final ? "for good" : "open"}`) : span(lasted(each, now)),
        String(each.count),
        worstOf(each),
        each.explanation,
      ])),
      found.length < NEWEST ? null : h("p", { class: "hint" }, "The open ones, and the newest of all; the keys [ and ] step through all of them."),
    ];
  }

  return { node: list.node, show };
}
