// A session's violations, the newest first.

import { Behind, get, of } from "./api.js";
import { h, Place } from "./dom.js";
import { at, moment } from "./words.js";

const PAGE = 20;
const MOST = 1000;

/** The list of violations; what is older is asked for by a button, which calls `again`. */
export function violationsView(id, again) {
  const list = new Place("section");
  const behind = new Behind();
  let [limit, latest] = [PAGE, null];

  async function refresh(state) {
    if (behind.changed(JSON.stringify([limit, state.properties.map((each) => each.violations)]))) {
      const { items, next } = await get(of(id, "violations"), { order: "desc", limit });
      latest = { items, more: next !== null && limit < MOST };
      behind.looked();
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
        h("a", { href: at(id, each.n) }, moment(each.stamp, clock)),
        each.order === "arrival" ? " by arrival: " : " ",
        each.explanation.text ?? `${each.property} does not hold`))),
      more ? h("button", { onclick: older }, "Older ones") : null,
    ];
  }

  return { node: list.node, refresh };
}
