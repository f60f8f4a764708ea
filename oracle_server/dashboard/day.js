// The episodes of the last 24 hours over all sessions: how many began when, as bars, which list them.

import { at } from "./address.js";
import { get } from "./api.js";
import { now } from "./clock.js";
import { h, Place, rove, table, TO_AND_FRO, UP_AND_DOWN, wide } from "./dom.js";
import { lasted, reasonOf, worstOf } from "./episodes.js";
import { counted, moment, span, zone } from "./words.js";

const DAY = 86_400_000; // ms
const [BARS, FEW] = [96, 48]; // on a wide page, and on a narrow one
const MOST = 1000; // episodes that are asked for at once, the newest ones
const PAGES = 10; // of which so many are asked for, until those of the last hour are all there
export const HOUR = 3_600_000; // ms
const LISTED = 100;
const [OFTEN, SELDOM] = [5_000, 60_000]; // ms until they are asked for again: where one began or ended, and else
const TALL = 40; // pixels

/** The day's episodes; `changed()` is called once other ones are to be listed. */
export function dayView(changed) {
  const head = new Place("p", {});
  const bars = h("div", { class: "bars", role: "toolbar", "aria-label": "Episodes by when they began; arrow keys go from one bar to the next" });
  const ends = h("div", { class: "ends", "aria-hidden": "true" });
  const list = new Place("div", wide("episodes that began then"));
  const node = h("section", { class: "day", "aria-label": "Episodes in 24 hours", hidden: true }, head.node, h("div", {}, bars, ends));
  const settle = rove(bars, "button", TO_AND_FRO);
  const settleList = rove(list.node, "a", UP_AND_DOWN);
  let [episodes, from, asked, known, chosen, drawn] = [[], 0, -Infinity, null, null, null];

  /** Ask for them where it is time to, or where others are `open` than before, or were, in one of the `sessions`; returns them, and from when (ms) on they are all of them. */
  async function refresh(open, sessions) {
    const failing = new Set(open.map(({ session }) => session));
    const others = sessions.filter(({ id }) => !failing.has(id)).map(({ id, violations }) => [id, violations]);
    const news = [...open.map(({ session, property, first }) => [session, property, first]), ...others].join();
    const passed = performance.now() - asked;
    if (passed < OFTEN || (passed < SELDOM && news === known)) return { episodes, from };
    [episodes, from] = await newest(BigInt(now() - DAY) * 1_000_000n);
    [asked, known] = [performance.now(), news];
    return { episodes, from };
  }

  /** Show those that are `wanted`, by when they began. */
  function show(wanted) {
    const count = matchMedia("(max-width: 40rem)").matches ? FEW : BARS;
    const width = DAY / count;
    const last = Math.floor(now() / width);
    const bins = Array.from({ length: count }, (_, i) => ({ at: (last - count + 1 + i) * width, found: [] }));
    for (const each of wanted) bins[Math.floor(time(each.began) / width) - bins[0].at / width]?.found.push(each);
    const shown = bins.find(({ at: from, found }) => from === chosen && found.length);
    node.hidden = !episodes.length;
    head.show([wanted.length, from > 0], () => [h("b", {}, `${wanted.length}${from ? " or more" : ""}`), ` ${wanted.length === 1 ? "episode" : "episodes"} in 24 h`]);
    const key = JSON.stringify([bins.map(({ at: from, found }) => [from, found.length]), shown?.at]);
    if (key !== drawn) draw(bins, width, shown);
    drawn = key;
    list.show(shown ? shown.found : null, (found) => (found ? listed(found) : []));
    settleList();
    list.node.hidden = !shown;
  }

  function draw(bins, width, shown) {
    const focused = bars.contains(document.activeElement) && document.activeElement.dataset.at;
    const most = Math.max(...bins.map(({ found }) => found.length), 4);
    bars.replaceChildren(...bins.map(({ at: from, found }) => {
      if (!found.length) return h("i");
      const text = `${counted(found.length, "episode")} from ${clock(from)} to ${clock(from + width)}`;
      const bar = h("i");
      bar.style.height = `${Math.max(4, (found.length / most) * TALL)}px`;
      return h("button", { "data-at": from, title: text, "aria-label": text, "aria-pressed": String(from === shown?.at), onclick: () => {
        chosen = chosen === from ? null : from;
        changed();
      } }, bar);
    }));
    settle();
    if (focused) bars.querySelector(`[data-at="${focused}"]`)?.focus();
    const until = bins.at(-1).at + width;
    ends.replaceChildren(...[4, 3, 2, 1].map((quarter) => h("span", {}, clock(until - (quarter / 4) * DAY))), h("span", {}, `now, ${zone(now() * 1e6)}`));
  }

  return { node, list: list.node, refresh, show };
}

/** The newest episodes since a time (ns), those of the last hour at least, and from when (ms) on they are all of them. */
async function newest(since) {
  const found = [];
  let after = null;
  for (let page = 0; page < PAGES; page++) {
    const { items, next } = await get("episodes", { since, order: "desc", limit: MOST, ...(after === null ? {} : { after }) });
    found.push(...items);
    if ((after = next) === null) return [found, 0];
    if (time(items.at(-1).began) < now() - HOUR) break;
  }
  return [found, time(found.at(-1).began)];
}

/** A time (ns) in ms. */
export function time(nanoseconds) {
  return Number(nanoseconds) / 1e6;
}

function clock(ms) {
  return new Date(ms).toTimeString().slice(0, 5);
}

function listed(found) {
  const rest = found.length - LISTED;
  return [
    table("episodes", ["began", "session", "property", "lasted", "violations", "worst, and why"], found.slice(0, LISTED).map((each) => [
      h("a", { href: at(each.session, each.first) }, moment(each.began)), each.session, each.property,
      each.open ? h("strong", { class: "bad" }, "open") : span(lasted(each, null)), String(each.count),
      [worstOf(each), reasonOf(each)].filter(Boolean).join(" · "),
    ])),
    rest > 0 ? h("p", { class: "hint" }, `and ${rest} more`) : null,
  ];
}
