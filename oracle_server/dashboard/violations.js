// A session's violations, the newest first.

import { get, of } from "./api.js";
import { h, Place } from "./dom.js";
import { at, moment } from "./words.js";

const PAGE = 20;
const MOST = 1000;
const LOOKS = 10; // at what has changed: the history is behind the state, and the longer the slower the disk is

/** The list of violations; what is older is asked for by a button. */
export function violationsView(id) {
  const list = new Place("section");
  let [limit, known, looks, latest] = [PAGE, null, 0, null];

  async function refresh(state) {
    const changed = JSON.stringify([limit, state.properties.map((each) => each.violations)]);
    if (changed !== known) looks = LOOKS;
    if (looks) {
      [known, looks] = [changed, looks - 1];
      const { items, next } = await get(of(id, "violations"), { order: "desc", limit });
      latest = { items, more: next !== null && limit < MOST };
    }
    list.show({ ...latest, clock: state.clock }, (shown) => listed(shown, () => {
      limit = Math.min(MOST, 2 * limit);
      return refresh(state);
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
