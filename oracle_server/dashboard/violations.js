// The list of a session's violations, the newest first.

import { DelayedHistory, get, of } from "./api.js";
import { h, Place } from "./dom.js";
import { at, place } from "./words.js";

const PAGE = 20;
const MOST = 1000;

/** A view of the violations; a button shows older ones, and calls `again` to refresh the page. */
export function violationsView(id, again) {
  const list = new Place("section");
  const history = new DelayedHistory();
  let [limit, latest] = [PAGE, null];

  async function refresh(state) {
    if (history.isDue(JSON.stringify([limit, state.properties.map((each) => each.violations)]))) {
      const { items, next } = await get(of(id, "violations"), { order: "desc", limit });
      latest = { items, more: next !== null && limit < MOST };
      history.wasRead();
    }
    list.show({ ...latest, clock: state.clock }, (shown) => listed(shown, () => {
      limit = Math.min(MOST, 2 * limit);
      again();
    }));
  }

  function listed({ items, more, clock }, older) {
    if (!items.length) return h("p", { class: "hint" }, "None.");
    return [
      h("ol", { class: "violations" }, items.map((each) => h("li", {},
        h("a", { href: at(id, each.n) }, place(each.step, each.stamp, clock)),
        each.order === "arrival" ? " by arrival: " : " ",
        each.explanation.text ?? `${each.property} does not hold`,
        h("span", { class: "hint" }, ` #${each.n}`)))),
      more ? h("button", { onclick: older }, "Older ones") : null,
    ];
  }

  return { node: list.node, refresh };
}
