// The list of a session's violations, the newest first.

import { at } from "./address.js";
import { DelayedHistory, get, of } from "./api.js";
import { h, Place, rove, UP_AND_DOWN } from "./dom.js";
import { noneOf } from "./episodes.js";
import { causes, place } from "./words.js";

const PAGE = 20;
const MOST = 1000;

/** A view of the violations; a button shows older ones, and calls `again` to refresh the page. */
export function violationsView(id, again) {
  const list = new Place("section", { "aria-label": "violations; arrow keys go from one to the next" });
  const settle = rove(list.node, "a", UP_AND_DOWN);
  const history = new DelayedHistory();
  let [limit, latest] = [PAGE, null];

  async function refresh(state) {
    if (history.isDue(JSON.stringify([limit, state.trouble, state.revising?.passes, state.properties.map((each) => each.violations)]))) {
      latest = await read();
      history.wasRead();
    }
    list.show({ ...latest, clock: state.clock, none: noneOf(state) }, (shown) => listed(shown, () => {
      limit = Math.min(MOST, 2 * limit);
      again();
    }));
    settle();
  }

  /** The newest violations, and whether there are more; further back where the newest records tell of retractions alone. */
  async function read() {
    for (;; limit = Math.min(MOST, 2 * limit)) {
      const { items, next } = await get(of(id, "violations"), { as: "all", order: "desc", limit });
      const found = { items: withRetractions(items), more: next !== null && limit < MOST, cut: next !== null };
      if (found.items.length || !found.more) return found;
    }
  }

  function listed({ items, more, cut, clock, none }, older) {
    if (!items.length) return h("p", { class: "hint" }, cut ? `Of the newest ${MOST} none stands.` : none);
    return [
      h("ol", { class: "violations" }, items.map((each) => entry(each, clock))),
      more ? h("button", { onclick: older }, "Older ones") : null,
      cut && !more ? h("p", { class: "hint" }, `Of the newest ${MOST}; there are older ones. The keys [ and ] step through all episodes.`) : null,
    ];
  }

  function entry({ record, retraction }, clock) {
    const text = record.explanation.text ?? `${record.property} does not hold`;
    const { stamp } = record.revises ? record.explanation.event : record;
    return h("li", retraction ? { class: "retracted", title: `${causes(retraction)} (#${retraction.n})` } : {},
      h("a", { href: at(id, verdictOf(record)) }, place(record.step, stamp, clock)),
      record.order === "arrival" ? " by arrival: " : " ",
      retraction ? h("s", {}, text) : text,
      h("span", { class: "hint" }, ` #${record.n}`),
      retraction ? h("strong", {}, " retracted") : null,
      record.revises ? h("span", { class: "hint" }, ` known since ${causes(record)}`) : null);
  }

  return { node: list.node, refresh };
}

/** The number of the verdict that a violation is at. */
function verdictOf(record) {
  return record.revises?.from ?? record.n;
}

/** The violations among records, the newest first, each with the revision by which it does not stand, if there is one. */
function withRetractions(records) {
  const retractions = new Map();
  const found = [];
  for (const record of records) {
    const n = verdictOf(record);
    if (record.retracted) retractions.set(n, record);
    else {
      found.push({ record, retraction: retractions.get(n) ?? null });
      retractions.delete(n);
    }
  }
  return found;
}
